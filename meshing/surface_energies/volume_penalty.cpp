#include "meshing/surface_energies/volume_penalty.h"

#include <cmath>

namespace testbed::meshing {

double TargetVolume::at(double t, double volume_at_hand) const {
  if (!curve.empty()) return at_rest * value_at(curve, t);
  return is_at_hand ? volume_at_hand : at_rest;
}

TargetVolume target_volume_of(const Scene& scene, double at_rest) {
  return {at_rest, scene.volume->target, scene.collapse.has_value()};
}

void VolumePenalty::begin_step(double t, double h, const Eigen::Matrix3Xd& x) {
  if (over_time_) target_ = over_time_->at(t + h, volume_of(faces_, x));
}

double VolumePenalty::energy(const Eigen::Matrix3Xd& x) const {
  const double excess = volume_of(faces_, x) - target_;
  return P_ / 2 * excess * excess / target_;
}

void VolumePenalty::add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const {
  thread_local Eigen::Matrix3Xd gradient;  // kept, so that a step allocates nothing
  const double V = volume_and_gradient(faces_, x, gradient);
  f.leftCols(gradient.cols()) += P_ * (target_ - V) / target_ * gradient;
}

void VolumePenalty::add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const {
  Eigen::Matrix3Xd g;
  volume_and_gradient(faces_, x, g);
  H.roots.emplace_back(std::sqrt(P_ / target_) * g);
  if (curvature == Curvature::Exact) H.add_volume(P_ * (volume_of(faces_, x) / target_ - 1), faces_, x);
}

}  // namespace testbed::meshing
