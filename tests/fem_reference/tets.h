// Measures of tetrahedra and of fields on them, and a box of them, for the tests of the reference.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::fem {

inline double volume_of(const Eigen::Matrix3Xd& X, const Eigen::Vector4i& t) {
  const Eigen::Vector3d a = X.col(t(0));
  return (X.col(t(1)) - a).cross(X.col(t(2)) - a).dot(X.col(t(3)) - a) / 6;
}

/// Values and gradients (by barycentric coordinates) of the Lagrange functions of 4 or 10 nodes in VTK's
/// order.
inline void shape_functions(int n, const Eigen::Vector4d& l, Eigen::VectorXd& N, Eigen::MatrixXd& dN) {
  constexpr int kEdges[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
  N.resize(n);
  dN.setZero(n, 4);
  for (int i = 0; i < 4; ++i) {
    N(i) = n == 4 ? l(i) : l(i) * (2 * l(i) - 1);
    dN(i, i) = n == 4 ? 1 : 4 * l(i) - 1;
  }
  for (int e = 0; n == 10 && e < 6; ++e) {
    const int i = kEdges[e][0], j = kEdges[e][1];
    N(4 + e) = 4 * l(i) * l(j);
    dN(4 + e, i) = 4 * l(j);
    dN(4 + e, j) = 4 * l(i);
  }
}

/// Largest |principal stretch - 1| of a displacement, at the centre of linear and at the four points of the
/// rule of degree 2 of quadratic tetrahedra.
inline double largest_stretch(const Eigen::Matrix3Xd& X, const Eigen::MatrixXi& cells,
                              const Eigen::Matrix3Xd& u) {
  const int n = static_cast<int>(cells.rows());
  const double b = n == 4 ? 0.25 : (5 - std::sqrt(5)) / 20;
  Eigen::VectorXd N;
  Eigen::MatrixXd dN;
  double largest = 0;
  for (const auto& cell : cells.colwise()) {
    Eigen::Matrix4d corners;
    corners << X(Eigen::all, cell.head<4>().eval()), Eigen::RowVector4d::Ones();
    const Eigen::Matrix<double, 4, 3> dl = corners.inverse().leftCols<3>();
    for (int i = 0; i < 4; ++i) {
      Eigen::Vector4d l = Eigen::Vector4d::Constant(b);
      l(i) = 1 - 3 * b;
      shape_functions(n, l, N, dN);
      const Eigen::Matrix3d F = Eigen::Matrix3d::Identity() + u(Eigen::all, cell) * dN * dl;
      const Eigen::Vector3d stretches = Eigen::JacobiSVD<Eigen::Matrix3d>(F).singularValues();
      largest = std::max(largest, (stretches.array() - 1).abs().maxCoeff());
    }
  }
  return largest;
}

struct FieldError {
  double l2, h1;  ///< of the field, of its gradient
};

/// L2 errors of a finite-element field, by Gauss points on the collapsed cube (exact to degree 5).
inline FieldError field_error(const Eigen::Matrix3Xd& X, const Eigen::MatrixXi& cells,
                              const Eigen::Matrix3Xd& u,
                              const std::function<Eigen::Vector3d(const Eigen::Vector3d&)>& exact,
                              const std::function<Eigen::Matrix3d(const Eigen::Vector3d&)>& gradient) {
  const double g = std::sqrt((3 + 2 * std::sqrt(6. / 5)) / 7), h = std::sqrt((3 - 2 * std::sqrt(6. / 5)) / 7);
  const double wg = (18 - std::sqrt(30)) / 36, wh = (18 + std::sqrt(30)) / 36;
  const std::array<double, 4> x{{(1 - g) / 2, (1 - h) / 2, (1 + h) / 2, (1 + g) / 2}},
      w{{wg / 2, wh / 2, wh / 2, wg / 2}};
  const int n = static_cast<int>(cells.rows());
  Eigen::VectorXd N;
  Eigen::MatrixXd dN;
  FieldError error{0, 0};
  for (const auto& cell : cells.colwise()) {
    Eigen::Matrix4d corners;
    corners << X(Eigen::all, cell.head<4>().eval()), Eigen::RowVector4d::Ones();
    const double volume = std::abs(corners.determinant()) / 6;
    const Eigen::Matrix<double, 4, 3> dl = corners.inverse().leftCols<3>();
    const Eigen::MatrixXd nodal = u(Eigen::all, cell);
    for (int i = 0; i < 4; ++i)
      for (int j = 0; j < 4; ++j)
        for (int k = 0; k < 4; ++k) {
          const double a = x[i], b = (1 - a) * x[j], c = (1 - a - b) * x[k];
          const Eigen::Vector4d l(1 - a - b - c, a, b, c);
          const double weight = 6 * volume * w[i] * w[j] * w[k] * (1 - a) * (1 - a - b);
          shape_functions(n, l, N, dN);
          const Eigen::Vector3d at = corners.topRows<3>() * l;
          error.l2 += weight * (nodal * N - exact(at)).squaredNorm();
          error.h1 += weight * (nodal * dN * dl - gradient(at)).squaredNorm();
        }
  }
  return {std::sqrt(error.l2), std::sqrt(error.h1)};
}

/// Largest distance of u from a field at the nodes X, relative to the field's largest value.
inline double largest_error(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& u,
                            const std::function<Eigen::Vector3d(const Eigen::Vector3d&)>& exact) {
  double error = 0, largest = 0;
  for (int i = 0; i < X.cols(); ++i) {
    error = std::max(error, (u.col(i) - exact(X.col(i))).norm());
    largest = std::max(largest, exact(X.col(i)).norm());
  }
  return error / largest;
}

/// u without the small rigid motion that fits it best at the points X.
inline Eigen::Matrix3Xd without_rigid_motion(const Eigen::Matrix3Xd& X, Eigen::Matrix3Xd u) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  Eigen::MatrixXd R(X.size(), 6);
  for (int i = 0; i < X.cols(); ++i) {
    R.block<3, 3>(3 * i, 0).setIdentity();
    for (int k = 0; k < 3; ++k)
      R.block<3, 1>(3 * i, 3 + k) = Eigen::Vector3d::Unit(k).cross(X.col(i) - centre);
  }
  u.reshaped() -= R * (R.transpose() * R).ldlt().solve(R.transpose() * u.reshaped());
  return u;
}

}  // namespace testbed::fem
