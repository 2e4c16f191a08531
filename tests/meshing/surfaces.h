// Small changes to surfaces, shared by the tests of meshing.
#pragma once

#include <Eigen/QR>
#include <cmath>

#include "meshing/base/mesh.h"

inline testbed::meshing::SurfaceMesh join(const testbed::meshing::SurfaceMesh& a,
                                          const testbed::meshing::SurfaceMesh& b) {
  testbed::meshing::SurfaceMesh both{Eigen::Matrix3Xd(3, a.X.cols() + b.X.cols()),
                                     Eigen::Matrix3Xi(3, a.F.cols() + b.F.cols())};
  both.X << a.X, b.X;
  both.F << a.F, (b.F.array() + static_cast<int>(a.X.cols())).matrix();
  return both;
}

inline testbed::meshing::SurfaceMesh inside_out(testbed::meshing::SurfaceMesh mesh) {
  mesh.F.row(0).swap(mesh.F.row(1));
  return mesh;
}

inline testbed::meshing::SurfaceMesh scaled(testbed::meshing::SurfaceMesh mesh, double factor) {
  mesh.X *= factor;
  return mesh;
}

/// With vertex `gone` made one with vertex `kept`, which is before it.
inline testbed::meshing::SurfaceMesh welded(testbed::meshing::SurfaceMesh mesh, int kept, int gone) {
  for (int& v : mesh.F.reshaped()) v = v == gone ? kept : v > gone ? v - 1 : v;
  const Eigen::Index n_after = mesh.X.cols() - gone - 1;
  mesh.X.middleCols(gone, n_after) = mesh.X.rightCols(n_after).eval();
  mesh.X.conservativeResize(3, mesh.X.cols() - 1);
  return mesh;
}

inline testbed::meshing::SurfaceMesh with_vertex(testbed::meshing::SurfaceMesh mesh,
                                                 const Eigen::Vector3d& x) {
  mesh.X.conservativeResize(3, mesh.X.cols() + 1);
  mesh.X.rightCols<1>() = x;
  return mesh;
}

inline testbed::meshing::SurfaceMesh with_triangle(testbed::meshing::SurfaceMesh mesh,
                                                   const Eigen::Vector3i& corners) {
  mesh.F.conservativeResize(3, mesh.F.cols() + 1);
  mesh.F.rightCols<1>() = corners;
  return mesh;
}

/// A closed band of 2 n triangles with one twist: it has one side.
inline testbed::meshing::SurfaceMesh moebius_strip(int n) {
  testbed::meshing::SurfaceMesh mesh{Eigen::Matrix3Xd(3, 2 * n), Eigen::Matrix3Xi(3, 2 * n)};
  for (int i = 0; i < n; ++i) {
    const double turn = 2 * 3.14159265358979323846 * i / n;
    const Eigen::Vector3d out(std::cos(turn), std::sin(turn), 0);
    const Eigen::Vector3d across = std::cos(turn / 2) * out + std::sin(turn / 2) * Eigen::Vector3d::UnitZ();
    mesh.X.col(2 * i) = out + 0.3 * across;
    mesh.X.col(2 * i + 1) = out - 0.3 * across;
    const int a = 2 * i, b = 2 * i + 1;
    const int c = i + 1 < n ? a + 2 : 1, d = i + 1 < n ? b + 2 : 0;
    mesh.F.col(2 * i) << a, c, b;
    mesh.F.col(2 * i + 1) << b, c, d;
  }
  return mesh;
}

inline testbed::meshing::SurfaceMesh shifted(testbed::meshing::SurfaceMesh mesh, const Eigen::Vector3d& by) {
  mesh.X.colwise() += by;
  return mesh;
}

/// A plate of 2 x 0.8 x 0.2 m on n points along one edge, all of whose faces' triangles meet in one far corner.
inline testbed::meshing::SurfaceMesh fanned_plate(int n) {
  testbed::meshing::SurfaceMesh plate{Eigen::Matrix3Xd(3, 2 * (n + 2)), Eigen::Matrix3Xi(3, 4 * (n + 1))};
  const int m = n + 2;  // corners of its outline
  for (int i = 0; i < m; ++i) {
    const Eigen::Vector2d x =
        i < n ? Eigen::Vector2d(2. * i / (n - 1), 0) : Eigen::Vector2d(i == n ? 2 : 0, 0.8);
    plate.X.col(i) << x, 0;
    plate.X.col(m + i) << x, 0.2;
  }
  int f = 0;
  for (int i = 0; i < m; ++i) {
    const int j = (i + 1) % m;
    plate.F.col(f++) << i, j, m + j;
    plate.F.col(f++) << i, m + j, m + i;
    if (j == m - 1 || i == m - 1) continue;
    plate.F.col(f++) << j, i, m - 1;
    plate.F.col(f++) << m + i, m + j, 2 * m - 1;
  }
  return plate;
}

/// Whether a point is a mean of others (3 x n), some of which may be the same.
inline bool lies_among(const Eigen::Vector3d& x, const Eigen::Matrix3Xd& corners) {
  Eigen::Matrix4Xd A(4, corners.cols());
  A << corners, Eigen::RowVectorXd::Ones(corners.cols());
  const Eigen::Vector4d b(x[0], x[1], x[2], 1);
  const Eigen::VectorXd weights = A.completeOrthogonalDecomposition().solve(b);
  return (A * weights - b).norm() < 1e-12 && weights.minCoeff() > -1e-12;
}
