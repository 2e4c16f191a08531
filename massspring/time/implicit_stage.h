// The nonlinear equation that every implicit scheme solves once or twice a step.
#pragma once

#include "massspring/time/constant_matrix.h"
#include "massspring/time/kept_factor.h"

namespace testbed::massspring {

/// Solves v = w + a M^-1 f(x, v), x = y + a v on the free directions as the minimum over x [(24)] of
///   1/(2 a^2) |x - y - a w|_M^2 + potential(x) + a R((x - y)/a),
/// R the power that damping takes, springs damped along their directions at the start [Martin et al. 2011].
/// Newton's method lowers the sum in every iteration, by a factor that it keeps or else by systems solved no
/// better than it needs. Where forces are linear, one system with a constant matrix gives it.
class ImplicitStage {
 public:
  /// Of Newton's last step, over the body's size: its error is less.
  static constexpr double kStepTolerance = 1e-9;

  /// @param keeps_step  steps have one length
  /// @param residual    that ends a step, as its last correction does: forces out of balance over load,
  /// inertia and forces. Contact is stiff, and steps with it end by the correction alone.
  ImplicitStage(EquationOfMotion& motion, bool keeps_step, double residual);

  /// @param start  where damping directions, rest lengths and the first guess of v come from
  StepReport solve(const State& start, double a, const Eigen::Matrix3Xd& y, const Eigen::Matrix3Xd& w,
                   Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& v);

  std::string solver_choice() const;
  /// What is kept from step to step.
  friend void archive(meshing::Archive& a, ImplicitStage& stage) { a(stage.solver_, stage.kept_); }

 private:
  Eigen::Matrix3Xd unbalanced(const State& start, const State& trial, double a, const Eigen::Matrix3Xd& w,
                              double& size) const;
  StepReport solve_linear(const State& start, double a, const Eigen::Matrix3Xd& y, const Eigen::Matrix3Xd& w,
                          Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& v);

  EquationOfMotion& motion_;
  ImplicitMatrix A_;
  LinearSolver solver_;
  KeptFactor kept_;
  std::optional<ConstantMatrix> constant_;  ///< of a linear motion
  double residual_;
  double load_size_;     ///< of the load (N)
  double size_;          ///< diagonal of the body's box at rest (m)
  double energy_scale_;  ///< E times volume (J)
};

}  // namespace testbed::massspring
