#include "massspring/integrators.h"

#include <cmath>

#include "massspring/conjugate_gradients.h"
#include "meshing/random.h"

namespace testbed {

using Eigen::Matrix3Xd;

TimeStepper::TimeStepper(const MassSpringModel& model, const Forces& forces, Integrator integrator,
                         double end)
    : model_(model), forces_(forces), integrator_(integrator) {
  prescribed_velocity_ = Matrix3Xd::Zero(3, model.network.X.cols());
  for (const Constraint& c : forces.constraints)
    prescribed_velocity_.col(c.node) = (Eigen::Matrix3d::Identity() - c.S) * c.displacement / end;
  if (integrator == Integrator::ImplicitEuler) K_ = stiffness_pattern(model);
}

Matrix3Xd TimeStepper::total_forces(const State& state) const {
  Matrix3Xd f = elastic_forces(model_, state) + forces_.load;
  if (model_.springs && model_.springs->damping > 0) add_damping_forces(*model_.springs, state.x, state.v, f);
  if (forces_.mass_damping > 0) f -= forces_.mass_damping * state.v * model_.mass.asDiagonal();
  return f;
}

/// dv = h W f(x, v); dx = h v with the old velocity (explicit) or the new one (symplectic) [paper 3.4].
StepReport TimeStepper::step_explicitly(State& state, double h, bool is_symplectic) {
  Matrix3Xd dv = total_forces(state) * (h * model_.mass.cwiseInverse()).asDiagonal();
  if (!is_symplectic) state.x += h * state.v;
  state.v += dv;
  filter(forces_.constraints, state.v);
  state.v += prescribed_velocity_;
  if (is_symplectic) state.x += h * state.v;
  return {};
}

/// (M - h df/dv - h^2 df/dx) dv = h (f + h df/dx v) on the unconstrained directions, dx = h (v + dv) [paper
/// eq. 7, method 5].
StepReport TimeStepper::step_implicitly(State& state, double h) {
  constexpr double kTolerance = 1e-6;
  constexpr int kMaxIterations = 2000;
  K_.set_zero();
  add_stiffness(model_, state, K_);
  Matrix3Xd Kv;
  filter(forces_.constraints, state.v);
  state.v += prescribed_velocity_;
  multiply(K_, state.v, Kv);
  Matrix3Xd b = h * (total_forces(state) - h * Kv);
  filter(forces_.constraints, b);

  A_ = K_;
  for (Eigen::Matrix3d& block : A_.block) block *= h * h;
  if (model_.springs && model_.springs->damping > 0) add_damping_matrix(*model_.springs, state.x, h, A_);
  for (int i = 0; i < A_.rows(); ++i)
    A_.block[A_.find(i, i)].diagonal().array() += model_.mass(i) * (1 + h * forces_.mass_damping);
  filter(forces_.constraints, A_);
  const std::vector<Eigen::Matrix3d> inverse_diagonal = block_jacobi(A_);

  Matrix3Xd dv = Matrix3Xd::Zero(3, b.cols());
  const SolveReport linear =
      conjugate_gradients([&](const Matrix3Xd& p, Matrix3Xd& y) { multiply(A_, p, y); },
                          [&](const Matrix3Xd& r, Matrix3Xd& z) {
                            z.resize(3, r.cols());
                            for (int i = 0; i < r.cols(); ++i) z.col(i) = inverse_diagonal[i] * r.col(i);
                          },
                          b, dv, kTolerance, kMaxIterations);
  state.v += dv;
  state.x += h * state.v;
  return {linear.is_converged ? Status::Ok : Status::NotConverged, 1, linear.iterations, linear.residual};
}

StepReport TimeStepper::step(State& state, double h) {
  const State before = state;
  StepReport report = integrator_ == Integrator::ImplicitEuler
                          ? step_implicitly(state, h)
                          : step_explicitly(state, h, integrator_ == Integrator::SymplecticEuler);
  // A body a million times its size has burst; its last sound state is kept.
  const double size = (model_.network.X.rowwise().maxCoeff() - model_.network.X.rowwise().minCoeff()).norm();
  const double extent = (state.x - model_.network.X).cwiseAbs().maxCoeff();
  if (!(extent < 1e6 * size) || !state.v.allFinite()) {
    state = before;
    report.status = Status::Diverged;
    return report;
  }
  state.t += h;
  return report;
}

double stable_step(const MassSpringModel& model, const State& state) {
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, state, K);
  Random random(1);
  Matrix3Xd v(3, state.x.cols()), Kv;
  for (double& c : v.reshaped()) c = random.uniform() - 0.5;
  double omega_squared = 0;
  constexpr int kIterations = 100;
  for (int i = 0; i < kIterations; ++i) {
    v /= std::sqrt(v.cwiseAbs2().colwise().sum().dot(model.mass));
    multiply(K, v, Kv);
    omega_squared = v.cwiseProduct(Kv).sum();
    v = Kv * model.mass.cwiseInverse().asDiagonal();
  }
  return 2 / std::sqrt(omega_squared);
}

}  // namespace testbed
