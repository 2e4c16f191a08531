#include "massspring/volume_force.h"

#include <Eigen/Geometry>
#include <cmath>

#include "meshing/surface.h"

namespace testbed {
namespace {

/// V (m3) and dV/dx, 3 x n: a third of the area vector A n of each triangle to each vertex.
double volume_and_gradient(const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) {
  gradient.setZero(3, x.cols());
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

}  // namespace

double volume_energy(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x) {
  const double excess = volume(x, F) - target;
  return P / 2 * excess * excess / target;
}

void add_volume_forces(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                       Eigen::Matrix3Xd& f) {
  thread_local Eigen::Matrix3Xd gradient;  // kept, so that a step allocates nothing
  const double V = volume_and_gradient(F, x, gradient);
  f += P * (target - V) / target * gradient;
}

Eigen::Matrix3Xd volume_stiffness_root(double P, double target, const Eigen::Matrix3Xi& F,
                                       const Eigen::Matrix3Xd& x) {
  Eigen::Matrix3Xd g;
  volume_and_gradient(F, x, g);
  return std::sqrt(P / target) * g;
}

}  // namespace testbed
