#include "meshing/surface_energies/enclosed_volume.h"

#include <Eigen/Geometry>
#include <cmath>

#include "meshing/surface/surface.h"

namespace testbed::meshing {

double volume_and_gradient(const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) {
  gradient.setZero(3, F.maxCoeff() + 1);
  const Eigen::Vector3d origin = x.col(0);
  double V = 0;
  for (const auto& t : F.colwise()) {
    const Eigen::Vector3d a = x.col(t(0)), b = x.col(t(1)), c = x.col(t(2));
    const Eigen::Vector3d sixth = (b - a).cross(c - a) / 6;
    V += (a - origin).dot(sixth);
    for (int i : t) gradient.col(i) += sixth;
  }
  return V;
}

double volume_energy(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x) {
  const double excess = volume(x, F) - target;
  return P / 2 * excess * excess / target;
}

void add_volume_forces(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                       Eigen::Matrix3Xd& f) {
  thread_local Eigen::Matrix3Xd gradient;  // kept, so that a step allocates nothing
  const double V = volume_and_gradient(F, x, gradient);
  f.leftCols(gradient.cols()) += P * (target - V) / target * gradient;
}

Eigen::Matrix3Xd volume_stiffness_root(double P, double target, const Eigen::Matrix3Xi& F,
                                       const Eigen::Matrix3Xd& x) {
  Eigen::Matrix3Xd g;
  volume_and_gradient(F, x, g);
  return std::sqrt(P / target) * g;
}

void add_rank_one(const Eigen::Matrix3Xd& g, const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) {
  y.leftCols(g.cols()) += g.cwiseProduct(p.leftCols(g.cols())).sum() * g;
}

void add_volume_curvature(double factor, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                          const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) {
  for (const auto& t : F.colwise()) {
    const Eigen::Vector3d e = x.col(t(1)) - x.col(t(0)), f = x.col(t(2)) - x.col(t(0));
    const Eigen::Vector3d de = p.col(t(1)) - p.col(t(0)), df = p.col(t(2)) - p.col(t(0));
    const Eigen::Vector3d change = factor / 6 * (de.cross(f) + e.cross(df));
    for (int i : t) y.col(i) += change;
  }
}

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
  struct Orbit {  // three points with two equal barycentric coordinates, of degree 4 [Dunavant 1985]
    double weight, equal;
  };
  constexpr Orbit kRule[] = {{0.10995174365532187, 0.091576213509770743},
                             {0.22338158967801147, 0.44594849091596489}};
  for (const auto& [weight, equal] : kRule)
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3d l = Eigen::Vector3d::Constant(equal);
      l(k) = 1 - 2 * equal;
      const double w = weight / 6;
      const Eigen::Matrix3Xd N = shape_functions(n, l(1), l(2));
      const Eigen::Matrix3d at = x * N.transpose();  // x, dx/dr, dx/ds
      v.volume += w * at.determinant();
      Eigen::Matrix3d cofactors;
      for (int c = 0; c < 3; ++c) cofactors.col(c) = at.col((c + 1) % 3).cross(at.col((c + 2) % 3));
      v.gradient += w * cofactors * N;
      for (int a = 0; a < n; ++a)
        for (int b = 0; b < n; ++b)
          // d2 det(x, y, z) / dx_a dx_b: antisymmetric in the functions and in the components.
          v.hessian.block<3, 3>(3 * a, 3 * b) +=
              w * cross_matrix(at * N.col(b).head<3>().cross(N.col(a).head<3>()));
    }
  return v;
}

}  // namespace testbed::meshing
