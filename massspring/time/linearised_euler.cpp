#include <cmath>

#include "massspring/time/constant_matrix.h"
#include "massspring/time/schemes.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

/// (M - h df/dv - h^2 df/dx) dv = h (f + h df/dx v) on the free directions, dx = h (v + dv) [paper eq. 7,
/// (23)]. With A the matrix on the left and f_0 the forces without damping, the right-hand side is
/// h f_0 + M v - A v.
class LinearisedEuler : public Scheme {
 public:
  LinearisedEuler(const EquationOfMotion& motion, const IntegratorOptions& options)
      : motion_(motion),
        tolerance_(options.linear_tolerance),
        curvature_(options.curvature),
        A_(motion, options.gradients),
        solver_(options.linear_solver) {}

  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    A_.set(state, state.x, {1 + h * motion_.forces.mass_damping, h * h, h}, curvature_);
    motion_.undamped_forces_at(state, b_);
    A_.multiply(state.v, Av_);
    b_ = h * b_ + momenta(motion_.model, state.v);
    filter(motion_.constraints, b_);
    b_ -= Av_;

    if (dv_.cols() != b_.cols()) dv_ = Matrix3Xd::Zero(3, b_.cols());
    filter(motion_.constraints, dv_);
    const SolveReport linear = solver_.solve(A_.system(), b_, dv_, tolerance_);  // from the last step's dv
    v = state.v + dv_;
    x = state.x + h * v;
    StepReport report;
    if (!linear.is_converged)
      report.status = std::isfinite(linear.residual) ? Status::NotConverged : Status::Diverged;
    report.newton_iterations = 1;
    report.linear_iterations = linear.iterations;
    report.residual = linear.residual;
    return report;
  }

  std::string solver_choice() const override { return solver_.choice(); }
  void archive_kept(Archive& a) override { a(solver_, dv_); }

 private:
  const EquationOfMotion& motion_;
  double tolerance_;
  Curvature curvature_;
  ImplicitMatrix A_;
  LinearSolver solver_;
  Matrix3Xd b_, Av_, dv_;
};

}  // namespace

MakeScheme make_minimising_euler;

std::unique_ptr<Scheme> make_implicit_euler(EquationOfMotion& motion, const IntegratorOptions& options) {
  // Linear forces need no linearisation, and then the matrix stays.
  if (is_linear(motion) && options.linear_solver == Krylov::Cg) return make_minimising_euler(motion, options);
  return std::make_unique<LinearisedEuler>(motion, options);
}

}  // namespace testbed::massspring
