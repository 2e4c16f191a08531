#include "fem_reference/elements/enclosed_volume.h"

#include <deal.II/base/quadrature_lib.h>

#include <Eigen/Geometry>

namespace testbed::fem {
namespace {

/// Values and derivatives by r and s of the n Lagrange functions of a triangle, a row each.
Eigen::Matrix3Xd shape_functions(Eigen::Index n, double r, double s) {
  const Eigen::Vector3d l(1 - r - s, r, s);
  const Eigen::Matrix<double, 2, 3> dl = (Eigen::Matrix<double, 2, 3>() << -1, 1, 0, -1, 0, 1).finished();
  Eigen::Matrix3Xd N(3, n);
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    if (n == 3) {
      N.col(i) << l(i), dl.col(i);
      continue;
    }
    N.col(i) << l(i) * (2 * l(i) - 1), (4 * l(i) - 1) * dl.col(i);
    N.col(3 + i) << 4 * l(i) * l(j), 4 * (l(i) * dl.col(j) + l(j) * dl.col(i));
  }
  return N;
}

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  return (Eigen::Matrix3d() << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0).finished();
}

}  // namespace

EnclosedVolume enclosed_volume(const Eigen::Matrix3Xd& x) {
  const Eigen::Index n = x.cols();
  EnclosedVolume v{0, Eigen::Matrix3Xd::Zero(3, n), Eigen::MatrixXd::Zero(3 * n, 3 * n)};
  static const dealii::QGaussSimplex<2> kPoints(3);  // exact to degree 5, where 3 is needed
  for (unsigned q = 0; q < kPoints.size(); ++q) {
    const double w = kPoints.weight(q) / 3;
    const Eigen::Matrix3Xd N = shape_functions(n, kPoints.point(q)[0], kPoints.point(q)[1]);
    const Eigen::Matrix3d at = x * N.transpose();  // x, dx/dr, dx/ds
    v.volume += w * at.determinant();
    Eigen::Matrix3d cofactors;
    for (int k = 0; k < 3; ++k) cofactors.col(k) = at.col((k + 1) % 3).cross(at.col((k + 2) % 3));
    v.gradient += w * cofactors * N;
    for (int a = 0; a < n; ++a)
      for (int b = 0; b < n; ++b)
        // d2 det(x, y, z) / dx_a dx_b: antisymmetric in the functions and in the components.
        v.hessian.block<3, 3>(3 * a, 3 * b) +=
            w * cross_matrix(at * N.col(b).head<3>().cross(N.col(a).head<3>()));
  }
  return v;
}

}  // namespace testbed::fem
