// An enclosed volume is kept near a target, as in a bag [paper 3.3, Hirota et al. 1999], or at it.
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
  double rounding(const Eigen::Matrix3Xd& x) const override;
  /// Its positive semidefinite part is P/V_1 (dV/dx)(dV/dx)^T. The other one, P (V - V_1)/V_1 d2V/dx2, has
  /// eigenvalues of both signs and vanishes at the target.
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;

 protected:
  /// The volume that the faces enclose at x (m3), also with its gradient as volume_and_gradient.
  virtual double volume_at(const Eigen::Matrix3Xd& x) const { return volume_of(faces_, x); }
  virtual double volume_at(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) const {
    return volume_and_gradient(faces_, x, gradient);
  }
  /// On the faces (Pa), of a volume V (m3).
  double pressure_of(double V) const { return pressure_ + P_ * (target_ - V) / target_; }

  double P_;
  Faces faces_;
  double target_;
  double pressure_ = 0;  // besides that of P (Pa)

 private:
  std::optional<TargetVolume> over_time_;
};

/// The volume enclosed by closed faces is V_1 to a part of 1e-9. A Lagrange multiplier does that, the pressure p (Pa)
/// of the augmented energy 1/2 P (V - V_1)^2 / V_1 - p (V - V_1) (J) [Hestenes 1969]. At its minimum p + P (V_1 - V)/V_1
/// is taken for p, and from the second minimum on what the secant through the last two foretells. P decides how
/// Newton's method goes, and not where it ends.
class HeldVolume : public VolumePenalty {
 public:
  HeldVolume(double P, Faces faces, const TargetVolume& over_time)
      : VolumePenalty(P, std::move(faces), over_time) {}

  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  bool renew(const Eigen::Matrix3Xd& x) override;
  std::optional<double> holding_pressure() const override { return found_; }
  std::shared_ptr<const SurfaceMemory> memory() const override;
  void remember(std::shared_ptr<const SurfaceMemory> memory) override;
  double stored(const Eigen::Matrix3Xd&) const override { return 0; }  // a constraint does work alone
  double work(const Eigen::Matrix3Xd& x) const override;

 private:
  struct Minimum {
    double pressure, excess;  // Pa; of V over V_1, as a part of it
  };
  std::optional<Minimum> last_;  // of the step at hand
  double found_ = 0;             // pressure of the last step (Pa)
  double before_ = 0;            // volume as the step began (m3)
};

}  // namespace testbed::meshing
