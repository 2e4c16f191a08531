#include "meshing/surface_energies/volume_penalty.h"

#include <cmath>
#include <limits>

namespace testbed::meshing {

double TargetVolume::at(double t, double volume_at_hand) const {
  if (!curve.empty()) return at_rest * value_at(curve, t);
  return is_at_hand ? volume_at_hand : at_rest;
}

TargetVolume target_volume_of(const Scene& scene, double at_rest) {
  return {at_rest, scene.volume->target, scene.collapse.has_value()};
}

void VolumePenalty::begin_step(double t, double h, const Eigen::Matrix3Xd& x) {
  if (over_time_) target_ = over_time_->at(t + h, volume_at(x));
}

double VolumePenalty::energy(const Eigen::Matrix3Xd& x) const {
  const double excess = volume_at(x) - target_;
  return P_ / 2 * excess * excess / target_ - pressure_ * excess;
}

void VolumePenalty::add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const {
  thread_local Eigen::Matrix3Xd gradient;  // kept, so that a step allocates nothing
  const double V = volume_at(x, gradient);
  f.leftCols(gradient.cols()) += pressure_of(V) * gradient;
}

double VolumePenalty::rounding(const Eigen::Matrix3Xd& x) const {
  Eigen::Matrix3Xd gradient;
  const double V = volume_at(x, gradient);
  return std::numeric_limits<double>::epsilon() * P_ * V / target_ * gradient.norm();
}

void VolumePenalty::add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const {
  Eigen::Matrix3Xd g;
  const double V = volume_at(x, g);
  H.roots.emplace_back(std::sqrt(P_ / target_) * g);
  if (curvature != Curvature::Projected) H.add_volume(-pressure_of(V), faces_, x);
}

void HeldVolume::begin_step(double t, double h, const Eigen::Matrix3Xd& x) {
  VolumePenalty::begin_step(t, h, x);
  pressure_ = found_;
  last_.reset();
  before_ = volume_at(x);
}

bool HeldVolume::renew(const Eigen::Matrix3Xd& x) {
  constexpr double kTolerance = 1e-9;
  const double V = volume_at(x);
  const Minimum now{pressure_, (V - target_) / target_};
  if (std::abs(now.excess) <= kTolerance) {
    found_ = pressure_of(V);
    return false;
  }
  double stiffness = P_;  // pressure that takes a volume away, over its part of the whole
  if (last_) {
    const double secant = (now.pressure - last_->pressure) / (now.excess - last_->excess);
    if (secant > 0 && std::isfinite(secant)) stiffness = secant;
  }
  pressure_ -= stiffness * now.excess;
  last_ = now;
  return true;
}

std::shared_ptr<const SurfaceMemory> HeldVolume::memory() const {
  SurfaceMemory memory;
  memory.pressure = found_;
  return std::make_shared<const SurfaceMemory>(std::move(memory));
}

void HeldVolume::remember(std::shared_ptr<const SurfaceMemory> memory) {
  found_ = memory->pressure;
}

double HeldVolume::work(const Eigen::Matrix3Xd& x) const {
  return found_ * (volume_at(x) - before_);
}

}  // namespace testbed::meshing
