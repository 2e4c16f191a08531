// An enclosed volume is kept near a target, as in a bag [paper 3.3, Hirota et al. 1999].
#pragma once

#include <optional>

#include "meshing/scene/scene.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// The target V_1 of a scene over time.
struct TargetVolume {
  double at_rest;   ///< of the body (m3)
  Curve curve;      ///< over the volume at rest
  bool is_at_hand;  ///< without a curve: the volume as a step begins, while rest lengths collapse [paper 4.4]

  /// At a time, or load factor (m3).
  double at(double t, double volume_at_hand) const;
};
/// @param scene  with volume forces
TargetVolume target_volume_of(const Scene& scene, double at_rest);

/// Energy (J) 1/2 P (V - V_1)^2 / V_1 [(7)] of the volume V enclosed by closed faces, with pressure
/// coefficient P (Pa) and target volume V_1 (m3): on each triangle the force P (V_1 - V)/V_1 A n.
class VolumePenalty : public SurfaceEnergy {
 public:
  VolumePenalty(double P, Faces faces, double target) : P_(P), faces_(std::move(faces)), target_(target) {}
  /// Each step has the target at its end.
  VolumePenalty(double P, Faces faces, const TargetVolume& over_time)
      : VolumePenalty(P, std::move(faces), over_time.at(0, over_time.at_rest)) {
    over_time_ = over_time;
  }

  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  void set_target(double volume) { target_ = volume; }
  const char* name() const override { return "volume"; }
  double energy(const Eigen::Matrix3Xd& x) const override;
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  /// Its positive semidefinite part is P/V_1 (dV/dx)(dV/dx)^T. The other one, P (V - V_1)/V_1 d2V/dx2, has
  /// eigenvalues of both signs and vanishes at the target.
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;

 private:
  double P_;
  Faces faces_;
  double target_;
  std::optional<TargetVolume> over_time_;
};

}  // namespace testbed::meshing
