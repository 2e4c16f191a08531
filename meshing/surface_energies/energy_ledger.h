// Where the energy of a body in motion comes from and where it goes.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Sums over a run's steps (J): what was put in, and what damping and friction have taken.
struct EnergyFlows {
  double loads = 0;      ///< work of dead loads
  double supports = 0;   ///< work of supports that move
  double obstacles = 0;  ///< work of obstacles that move
  /// Change of surface energies as steps begin, at fixed positions: volume targets, handles; and work of held volumes.
  double targets = 0;
  double rest = 0;    ///< change of the elastic energy at fixed positions: collapse, relaxation
  double events = 0;  ///< that of elastic and surface energies, as values change on the way
  double damping = 0, friction = 0;

  double put_in() const { return loads + supports + obstacles + targets + rest + events; }
};

/// A body's balance of energy from a beginning on:
///   kinetic + elastic + surface = those at the beginning + put in - damping - friction - scheme,
/// where `scheme` is the rest: what the time integration has lost. What grows beyond all that was put in by more
/// than kTolerance of the largest energy met so far comes from nothing. It is plain data that a state may hold.
class EnergyLedger {
 public:
  /// Of the largest energy met so far. Explicit and trapezoidal schemes sway by less on every shipped scene.
  static constexpr double kTolerance = 0.1;

  /// @param rounding  of the sums (J), which is no gain
  void begin(double kinetic, double elastic, const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x,
             double rounding);
  bool has_begun() const { return has_begun_; }

  /// Other values hold from here on, at the same positions x.
  /// @param elastic   what they add to the elastic energy (J)
  /// @param rounding  as begin
  void change(double elastic, const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x, double rounding);

  /// After the surface's energies have begun a step at x: their change is put in, but for that of contact, whose
  /// obstacles do work along their way.
  void begin_step(const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x);
  /// They have ended it at x.
  void end_step(const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x);
  /// Takes the balance after a step, whose flows are in.
  void settle(double kinetic, double elastic);

  /// Largest growth so far beyond what was put in, over the largest energy until then.
  double gain() const { return gain_; }
  bool has_gained() const { return gain_ > kTolerance; }

  /// Columns of curves.csv (J) by their names: energies of the surface, flows that a run may have, the rest.
  std::vector<std::pair<std::string, double>> columns(const SurfaceEnergies& surface, double kinetic,
                                                      double elastic) const;

  EnergyFlows flows;

  friend void archive(Archive& a, EnergyLedger& ledger) {
    EnergyFlows& flows = ledger.flows;
    a(flows.loads, flows.supports, flows.obstacles, flows.targets, flows.rest, flows.events, flows.damping,
      flows.friction);
    a(ledger.has_begun_, ledger.is_open_, ledger.stored_, ledger.start_, ledger.surface_start_);
    a(ledger.rounding_, ledger.least_, ledger.largest_, ledger.gain_);
  }

 private:
  double surface_energy() const;
  double balance(double kinetic, double elastic) const;

  bool has_begun_ = false;
  bool is_open_ = false;        // no energy at the beginning: that after the first step counts
  std::vector<double> stored_;  // of each surface energy after the last step
  double start_ = 0, surface_start_ = 0, rounding_ = 0;
  double least_ = 0, largest_ = 0, gain_ = 0;
};

}  // namespace testbed::meshing
