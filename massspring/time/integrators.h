// Steps in time.
#pragma once

#include "massspring/time/schemes.h"

namespace testbed::massspring {

/// Moves constrained directions at the speed that reaches their displacement at `end`, and all else by the
/// laws of motion.
class TimeStepper {
 public:
  /// @param integrator  name among integrators()
  /// @param end  time at which prescribed displacements are complete (s)
  /// @throws std::runtime_error as find_integrator and check_contacts; for consistent mass with explicit schemes;
  /// for a body without extent
  TimeStepper(const MassSpringModel& model, const Forces& forces, const std::string& integrator, double end,
              const IntegratorOptions& options = {}, const Contacts& contacts = kNoContacts);

  /// Advances the state by h seconds; leaves it unchanged where the step diverges, which is when a position
  /// or velocity is not finite or the body a million times its size. With a tolerance in parts, each taken
  /// whole and in halves, whose difference tells the error [Hairer et al. 1993, II.4]. A step within which
  /// Newton's method of a scheme that minimises does not end is taken in halves, down to a 64th if need be. Where one of
  /// those has no end either, what is left of the step is not cut further: 13 minimisations at most.
  /// What decides later steps is in the state; matrices, their factors and preconditioners, and first guesses
  /// are kept from step to step and change a step within its tolerance.
  StepReport step(State& state, double h);

  /// All that acts on the surface, as it does at a state.
  SurfaceEnergies surface_at(const State& state) const;

  std::string solver_choice() const { return scheme_->solver_choice(); }
  /// What is kept besides the state: with both, steps go on bit for bit.
  void archive_kept(meshing::Archive& a) { scheme_->archive_kept(a); }

 private:
  StepReport step_whole(State& state, double h);
  StepReport step_or_halves(State& state, double h, int n_halvings);
  StepReport step_in_parts(State& state, double h);
  bool stays_at_rest(const State& state, double h);
  void constrain_touching(const State& state, double h);
  void step_in_touch(const State& state, double h, std::vector<Eigen::VectorXd>& clearance,
                     meshing::EnergyFlows& flows);
  double damping_power_at(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v) const;
  double work_of_supports(const State& state, double h) const;

  EquationOfMotion motion_;
  const Integrator& integrator_;
  IntegratorOptions options_;
  double end_;
  std::vector<Constraint> supports_;
  bool is_driven_;    ///< by supports
  double size_;       ///< of the body's box (m)
  double rest_norm_;  ///< of all positions at rest (m)
  std::unique_ptr<Scheme> scheme_, in_touch_;
  Eigen::Matrix3Xd x_, v_, v_before_;  ///< at the step's end; at its beginning
};

/// Largest stable step (s) of the symplectic Euler method for small motions about `state`, by the largest
/// eigenvalue omega^2 of M^-1 K [Lanczos 1950]: 2/omega, less where velocities are damped by c per second:
/// h^2 omega^2 + 2 h c = 4. Damping by the springs is not counted.
double stable_step(const MassSpringModel& model, const Forces& forces, const State& state);

}  // namespace testbed::massspring
