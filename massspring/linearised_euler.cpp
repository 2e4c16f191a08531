#include "massspring/integrators.h"
#include "massspring/linear_solver.h"
#include "massspring/volume_force.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

/// (M - h df/dv - h^2 df/dx) dv = h (f + h df/dx v) on the free directions, dx = h (v + dv) [paper eq. 7,
/// method 5].
class LinearisedEuler : public Scheme {
 public:
  LinearisedEuler(const Motion& motion, double tolerance)
      : motion_(motion), tolerance_(tolerance), A_(stiffness_pattern(motion.model)) {}

  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    const auto& [model, forces, end] = motion_;
    A_.set_zero();
    add_stiffness(model, state, A_);
    multiply(A_, state.v, b_);
    std::optional<Matrix3Xd> g;
    if (forces.volume_pressure) {
      g = volume_stiffness_root(*forces.volume_pressure, state.target_volume, model.network.F, state.x);
      b_ += g->cwiseProduct(state.v).sum() * *g;
      *g *= h;
      filter(forces.constraints, *g);
    }
    motion_.forces_at(state, f_);
    b_ = h * (f_ - h * b_);
    filter(forces.constraints, b_);

    for (Eigen::Matrix3d& block : A_.block) block *= h * h;
    if (model.springs && model.springs->damping > 0) add_damping_matrix(*model.springs, state.x, h, A_);
    for (int i = 0; i < A_.rows(); ++i)
      A_.block[A_.diagonal[i]].diagonal().array() += model.mass(i) * (1 + h * forces.mass_damping);
    filter(forces.constraints, A_);

    if (dv_.cols() != b_.cols()) dv_ = Matrix3Xd::Zero(3, b_.cols());
    filter(forces.constraints, dv_);
    const SolveReport linear = solver_.solve(A_, g, b_, dv_, tolerance_);  // from the last step's dv
    v = state.v + dv_;
    x = state.x + h * v;
    return {linear.is_converged ? Status::Ok : Status::NotConverged, 1, linear.iterations, linear.residual};
  }

  std::string solver_choice() const override { return solver_.choice(); }

 private:
  const Motion& motion_;
  double tolerance_;
  BlockMatrix A_;
  LinearSolver solver_;
  Matrix3Xd f_, b_, dv_;
};

}  // namespace

std::unique_ptr<Scheme> make_implicit_euler(const Motion& motion, const IntegratorOptions& options) {
  return std::make_unique<LinearisedEuler>(motion, options.linear_tolerance);
}

}  // namespace testbed
