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

}  // namespace testbed::meshing
