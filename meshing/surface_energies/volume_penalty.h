// An enclosed volume is kept near a target, as in a bag [paper 3.3, Hirota et al. 1999].
#pragma once

#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Energy (J) 1/2 P (V - V_1)^2 / V_1 [(7)] of the volume V enclosed by closed faces, with pressure
/// coefficient P (Pa) and target volume V_1 (m3): on each triangle the force P (V_1 - V)/V_1 A n.
class VolumePenalty : public SurfaceEnergy {
 public:
  VolumePenalty(double P, Faces faces, double target) : P_(P), faces_(std::move(faces)), target_(target) {}

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
};

}  // namespace testbed::meshing
