// Steps in time.
#pragma once

#include <memory>
#include <string>

#include "massspring/model/model.h"
#include "massspring/time/implicit_matrix.h"

namespace testbed::massspring {

struct IntegratorOptions {
  double linear_tolerance = 1e-6;  ///< of the linearised implicit step: |b - A dv| / |b|
  Gradients gradients = {};        ///< of the linearised implicit step
  Krylov linear_solver = Krylov::Cg;
  double tolerance = 0;    ///< error of a part of a step over the body's size; 0: steps are taken whole
  double sleep_below = 0;  ///< speed (m/s) below which a body that stays so is not stepped
};

/// One scheme: positions and velocities h seconds after a state whose constrained velocities are those
/// prescribed.
class Scheme {
 public:
  virtual ~Scheme() = default;
  virtual StepReport advance(const State& state, double h, Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& v) = 0;
  /// Why its linear systems are solved as they are; empty where there are none.
  virtual std::string solver_choice() const { return {}; }
};

std::unique_ptr<Scheme> make_explicit_euler(const Motion& motion);
std::unique_ptr<Scheme> make_symplectic_euler(const Motion& motion);
std::unique_ptr<Scheme> make_rk4(const Motion& motion);
std::unique_ptr<Scheme> make_implicit_euler(const Motion& motion, const IntegratorOptions& options);
std::unique_ptr<Scheme> make_minimising_euler(Motion& motion);
std::unique_ptr<Scheme> make_midpoint(Motion& motion);
std::unique_ptr<Scheme> make_bdf2(Motion& motion);
std::unique_ptr<Scheme> make_tr_bdf2(Motion& motion);

/// Explicit schemes have a largest stable step.
bool is_explicit(Integrator integrator);

/// Moves constrained directions at the speed that reaches their displacement at `end`, and all else by the
/// laws of motion.
class TimeStepper {
 public:
  /// @param end  time at which prescribed displacements are complete (s)
  /// @throws std::runtime_error for spread mass with explicit schemes; for midpoint with obstacles: it ends a
  /// step beyond where it solves; for a tolerance with contacts or bdf2, which remember the step before; for
  /// a body without extent
  TimeStepper(const MassSpringModel& model, const Forces& forces, Integrator integrator, double end,
              const IntegratorOptions& options = {}, const Contacts& contacts = no_contacts);

  /// Advances the state by h seconds; leaves it unchanged where the step diverges, which is when a position
  /// or velocity is not finite or the body a million times its size. With a tolerance in parts, each taken
  /// whole and in halves, whose difference tells the error [Hairer et al. 1993, II.4]. A step within which
  /// Newton's method of a scheme that minimises does not end is taken in halves, again and again if need be.
  StepReport step(State& state, double h);

  std::string solver_choice() const { return scheme_->solver_choice(); }

 private:
  StepReport step_whole(State& state, double h);
  StepReport step_or_halves(State& state, double h, int n_halvings);
  StepReport step_in_parts(State& state, double h);
  bool stays_at_rest(const State& state, double h) const;

  Motion motion_;
  Integrator integrator_;
  IntegratorOptions options_;
  double part_ = 0;  ///< length of the next part of a step (s)
  double end_;
  std::vector<Constraint> supports_;
  Touches touches_;
  PushOut push_out_;
  double size_;       ///< of the body's box (m)
  double rest_norm_;  ///< of all positions at rest (m)
  std::unique_ptr<Scheme> scheme_;
  Eigen::Matrix3Xd x_, v_, v_before_;
};

/// Largest stable step (s) of the symplectic Euler method for small motions about `state`, by the largest
/// eigenvalue omega^2 of M^-1 K [Lanczos 1950]: 2/omega, less where velocities are damped by c per second:
/// h^2 omega^2 + 2 h c = 4. Damping by the springs is not counted.
double stable_step(const MassSpringModel& model, const Forces& forces, const State& state);

}  // namespace testbed::massspring
