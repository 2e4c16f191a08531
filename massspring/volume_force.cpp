#include "massspring/volume_force.h"

#include <Eigen/Geometry>
#include <cmath>

#include "meshing/surface.h"

namespace testbed {
namespace {

/// f += factor dV/dx.
void add_volume_gradient(double factor, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                         Eigen::Matrix3Xd& f) {
  for (const auto& t : F.colwise()) {
    const Eigen::Vector3d a = x.col(t(0)), b = x.col(t(1)), c = x.col(t(2));
    const Eigen::Vector3d sixth = factor / 6 * (b - a).cross(c - a);  // a third of the area vector A n
    for (int i : t) f.col(i) += sixth;
  }
}

}  // namespace

double volume_energy(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x) {
  const double excess = volume(x, F) - target;
  return P / 2 * excess * excess / target;
}

void add_volume_forces(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                       Eigen::Matrix3Xd& f) {
  add_volume_gradient(P * (target - volume(x, F)) / target, F, x, f);
}

Eigen::Matrix3Xd volume_stiffness_root(double P, double target, const Eigen::Matrix3Xi& F,
                                       const Eigen::Matrix3Xd& x) {
  Eigen::Matrix3Xd g = Eigen::Matrix3Xd::Zero(3, x.cols());
  add_volume_gradient(std::sqrt(P / target), F, x, g);
  return g;
}

}  // namespace testbed
