#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "meshing/base/geometry.h"
#include "meshing/surface/shapes.h"
#include "meshing/tetrahedra/tet_mesh.h"
#include "meshing/tetrahedra/tetrahedralize.h"

using namespace testbed::meshing;

namespace {

constexpr double kRounding = 1e-12;

std::string complaint(const TetMesh& mesh, const SurfaceMesh& surface) {
  try {
    check_tetrahedra(mesh, surface);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST(CheckTetrahedra, SeesEveryFault) {
  const SurfaceMesh surface = make_shape("ball", 42);
  const TetMesh good = tetrahedralize(surface);
  ASSERT_EQ(complaint(good, surface), "");
  auto expect = [&](const TetMesh& mesh, const std::string& fault) {
    EXPECT_NE(complaint(mesh, surface).find(fault), std::string::npos) << complaint(mesh, surface);
  };
  TetMesh bad = good;
  bad.X(0, 7) = std::nextafter(bad.X(0, 7), 2);
  expect(bad, "moved");
  bad = good;
  std::swap(bad.T(0, 3), bad.T(1, 3));
  expect(bad, "tetrahedron 3 has volume");
  bad = good;
  bad.T.conservativeResize(4, bad.T.cols() - 1);
  expect(bad, "of the surface's volume");
  bad = good;
  bad.T.resize(4, 0);
  expect(bad, "none were made");
  bad = good;
  bad.X.conservativeResize(3, bad.X.cols() + 1);
  bad.X.rightCols(1).setZero();
  expect(bad, "node " + std::to_string(good.X.cols()) + " is a corner of none");
  SurfaceMesh other = surface;
  other.F.col(5) = other.F.col(5).reverse().eval();
  EXPECT_EQ(complaint(good, other), "tetrahedra: boundary triangles are not the surface's");
}

TEST(CheckTetrahedra, SeesFacesThatDoNotFitWhereTheVolumeDoes) {
  // a tetrahedron cut from its centroid into four of the same volume
  SurfaceMesh surface{Eigen::Matrix3Xd(3, 4), Eigen::Matrix3Xi(3, 4)};
  surface.X << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1;
  surface.F << 0, 0, 0, 1, 2, 1, 3, 2, 1, 3, 2, 3;
  TetMesh good{Eigen::Matrix3Xd(3, 5), Eigen::Matrix4Xi(4, 4), surface.F, 4};
  good.X << surface.X, Eigen::Vector3d::Constant(0.25);  // the centroid
  for (int f = 0; f < 4; ++f) good.T.col(f) << surface.F(0, f), surface.F(2, f), surface.F(1, f), 4;
  ASSERT_EQ(complaint(good, surface), "");

  TetMesh cracked = good;
  cracked.X.conservativeResize(3, 6);
  cracked.X.col(5) = cracked.X.col(4);
  cracked.T(3, 2) = cracked.T(3, 3) = 5;
  EXPECT_EQ(complaint(cracked, surface),
            "tetrahedra: 0 surface triangles are not on their boundary, which has 12 faces, expected 4");
  TetMesh stacked = good;
  stacked.T.col(2) = stacked.T.col(1) = stacked.T.col(0);
  EXPECT_EQ(complaint(stacked, surface), "tetrahedra: a face belongs to more than two of them");
}

TEST(CheckTetrahedra, SeesADiagonalThatTheSurfaceHasTurned) {
  const SurfaceMesh cube = make_shape("bar", 8, {1, 1, 1});
  TetMesh mesh = tetrahedralize(cube);
  ASSERT_EQ(complaint(mesh, cube), "");
  SurfaceMesh turned = cube;  // the same vertices and volume
  ASSERT_EQ(turned.F.leftCols(2), (Eigen::Matrix<int, 3, 2>() << 0, 0, 1, 2, 2, 3).finished());
  turned.F.leftCols(2) << 0, 1, 1, 2, 3, 3;
  mesh.F = turned.F;
  EXPECT_EQ(complaint(mesh, turned),
            "tetrahedra: 2 surface triangles are not on their boundary, which has 12 faces, expected 12");
}

TEST(TetVolume, OfTheUnitCornerIsASixth) {
  Eigen::Matrix3Xd X(3, 4);
  X << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1;
  EXPECT_NEAR(tet_volume(X, {0, 1, 2, 3}), 1.0 / 6, kRounding);
  EXPECT_NEAR(tet_volume(X, {0, 2, 1, 3}), -1.0 / 6, kRounding);
}

TEST(TetQuality, OfARegularTetrahedronAndOfASliver) {
  Eigen::Matrix3Xd X(3, 4);
  X << 1, 1, -1, -1,  //
      1, -1, 1, -1,   //
      1, -1, -1, 1;
  Eigen::Matrix4Xi T(4, 1);
  T << 0, 1, 3, 2;
  if (tet_volume(X, T.col(0)) < 0) T.col(0).tail<2>().reverseInPlace();
  const TetQuality regular = tet_quality(X, T);
  EXPECT_NEAR(regular.min_dihedral, std::acos(1.0 / 3) * 180 / 3.14159265358979323846, 1e-9);
  EXPECT_NEAR(regular.min_radius_ratio, 1, kRounding);
  EXPECT_NEAR(regular.mean_radius_ratio, 1, kRounding);
  EXPECT_EQ(regular.n_slivers, 0);
  X.row(2) *= 0.002;  // nearly flat
  const TetQuality flat = tet_quality(X, T);
  EXPECT_LT(flat.min_dihedral, 1);
  EXPECT_LT(flat.min_radius_ratio, 0.01);
  EXPECT_EQ(flat.n_slivers, 1);
}

TEST(TetQuality, IsThatOfTheSpheresThatTouchTheFacesAndHoldTheCorners) {
  const SurfaceMesh surface = make_shape("torus", 300);
  const TetMesh mesh = tetrahedralize(surface);
  double least = 1, mean = 0;
  for (const auto& tet : mesh.T.colwise()) {
    // both centres from linear equations: |x - X_c|^2 = R^2 at all corners, n_f . x + r = d_f at all faces
    Eigen::Matrix3d apart;
    Eigen::Vector3d squares;
    Eigen::Matrix4d faces;
    Eigen::Vector4d planes;
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d a = mesh.X.col(tet[(c + 1) % 4]), b = mesh.X.col(tet[(c + 2) % 4]),
                            d = mesh.X.col(tet[(c + 3) % 4]), top = mesh.X.col(tet[c]);
      Eigen::Vector3d normal = (b - a).cross(d - a).normalized();
      if (normal.dot(top - a) > 0) normal = -normal;
      faces.row(c) << normal.transpose(), 1;
      planes[c] = normal.dot(a);
      if (c == 0) continue;
      const Eigen::Vector3d first = mesh.X.col(tet[0]);
      apart.row(c - 1) = 2 * (top - first).transpose();
      squares[c - 1] = top.squaredNorm() - first.squaredNorm();
    }
    const double inscribed = faces.partialPivLu().solve(planes)[3];
    const Eigen::Vector3d centre = apart.partialPivLu().solve(squares);
    const double ratio = 3 * inscribed / (centre - mesh.X.col(tet[0])).norm();
    least = std::min(least, ratio);
    mean += ratio / mesh.T.cols();
  }
  const TetQuality quality = tet_quality(mesh.X, mesh.T);
  EXPECT_NEAR(quality.min_radius_ratio, least, 1e-9);
  EXPECT_NEAR(quality.mean_radius_ratio, mean, 1e-9);
}

TEST(TetQuality, ASliverIsJudgedByItsLongestEdgeWhicheverThatIs) {
  // The longest edge is 2 m, and 6 sqrt(2) V / 8 is a b / (2 sqrt(2)), half of the limit of 0.05.
  // The next longest edge, of sqrt(1 + a^2), would make that 8 / (1 + a^2)^1.5 = 7.8 times as much.
  const double a = 0.13, b = 0.025 * 2 * std::sqrt(2.0) / a;
  Eigen::Matrix3Xd corners(3, 4);
  corners << -1, 1, 0, 0,  //
      0, 0, a, 0,          //
      0, 0, 0, b;
  std::array<int, 4> order{0, 1, 2, 3};
  do {
    const Eigen::Matrix3Xd X = corners(Eigen::all, order);
    if (tet_volume(X, {0, 1, 2, 3}) > 0) {
      EXPECT_EQ(tet_quality(X, Eigen::Vector4i(0, 1, 2, 3)).n_slivers, 1) << order[0] << order[1] << order[2];
    }
  } while (std::next_permutation(order.begin(), order.end()));
}
