// Steps in time.
#pragma once

#include <memory>

#include "massspring/model.h"

namespace testbed {

/// Moves constrained directions at the speed that reaches their displacement at `end`, and all else by the
/// laws of motion.
class TimeStepper {
 public:
  /// @param end  time at which prescribed displacements are complete (s)
  TimeStepper(const MassSpringModel& model, const Forces& forces, Integrator integrator, double end);

  /// Advances the state by h seconds.
  StepReport step(State& state, double h);

 private:
  StepReport step_explicitly(State& state, double h, bool is_symplectic);
  StepReport step_implicitly(State& state, double h);
  Eigen::Matrix3Xd total_forces(const State& state) const;

  const MassSpringModel& model_;
  const Forces& forces_;
  Integrator integrator_;
  Eigen::Matrix3Xd prescribed_velocity_;  ///< 0 where free (m/s)
  BlockMatrix K_, A_;                     ///< allocated by the implicit integrator only
};

/// Largest stable step of the symplectic Euler method, 2 / omega_max (s), by power iteration on M^-1 K.
double stable_step(const MassSpringModel& model, const State& state);

}  // namespace testbed
