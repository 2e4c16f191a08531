#include "massspring/integrators.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <stdexcept>

#include "massspring/block_matrix.h"
#include "meshing/random.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

std::unique_ptr<Scheme> make_scheme(Integrator integrator, const Motion& motion,
                                    const IntegratorOptions& options) {
  switch (integrator) {
    case Integrator::ExplicitEuler:
      return make_explicit_euler(motion);
    case Integrator::SymplecticEuler:
      return make_symplectic_euler(motion);
    case Integrator::Rk4:
      return make_rk4(motion);
    case Integrator::ImplicitEuler:
      return make_implicit_euler(motion, options);
    case Integrator::MinimisingEuler:
      return make_minimising_euler(motion);
    case Integrator::Midpoint:
      return make_midpoint(motion);
    case Integrator::Bdf2:
      return make_bdf2(motion);
    case Integrator::TrBdf2:
      return make_tr_bdf2(motion);
  }
  throw std::logic_error("unknown integrator");
}

}  // namespace

bool is_explicit(Integrator integrator) {
  return integrator == Integrator::ExplicitEuler || integrator == Integrator::SymplecticEuler ||
         integrator == Integrator::Rk4;
}

TimeStepper::TimeStepper(const MassSpringModel& model, const Forces& forces, Integrator integrator,
                         double end, const IntegratorOptions& options)
    : motion_(model, forces, end),
      integrator_(integrator),
      end_(end),
      supports_(motion_.constraints),
      largest_extent_(1e6 *
                      (model.network.X.rowwise().maxCoeff() - model.network.X.rowwise().minCoeff()).norm()),
      scheme_(make_scheme(integrator, motion_, options)) {
  if (forces.bodies.empty() || is_explicit(integrator) || integrator == Integrator::ImplicitEuler) return;
  if (integrator == Integrator::Midpoint)
    throw std::runtime_error("time.integrator = midpoint with obstacles, expected another one");
  motion_.barrier.emplace(model, forces);
}

StepReport TimeStepper::step(State& state, double h) {
  const std::vector<RigidBody>& bodies = motion_.forces.bodies;
  const bool is_linearised = integrator_ == Integrator::ImplicitEuler;
  if (motion_.self_contact) motion_.self_contact->begin_step(state.x);
  if (motion_.barrier) motion_.barrier->begin_step(state.t, h, state.x);
  if (is_linearised && !bodies.empty()) {
    motion_.constraints = supports_;
    touches_.hold(bodies, state, h, motion_.constraints, motion_.friction);
    v_before_ = state.v;
  }
  motion_.constrain(state.v);
  StepReport report = scheme_->advance(state, h, x_, v_);
  if (is_linearised && !bodies.empty()) {
    State after = state;
    after.x = x_;
    after.v = v_;
    Matrix3Xd f;
    motion_.forces_at(after, f);
    f = (v_ - v_before_) * (motion_.model.mass / h).asDiagonal() - f;
    touches_.settle(bodies, state, h, f, x_, v_);
  } else if (is_explicit(integrator_)) {
    push_out(bodies, state, h, x_, v_);
  }
  const Matrix3Xd& X = motion_.model.network.X;
  prescribe(supports_, X, (state.t + h) / end_, x_);
  const double extent = (x_ - X).norm();  // one pass; not finite where any position is not
  if (!(extent < largest_extent_) || !std::isfinite(v_.squaredNorm())) report.status = Status::Diverged;
  if (report.status == Status::Diverged) return report;
  state.x.swap(x_);
  state.v.swap(v_);
  state.t += h;
  return report;
}

double stable_step(const MassSpringModel& model, const Forces& forces, const State& state) {
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, state, K);
  const std::optional<Matrix3Xd> g = volume_stiffness_root(model, forces, state);
  const Eigen::VectorXd scale = model.mass.cwiseSqrt().cwiseInverse();
  Matrix3Xd scaled, Kq;
  const auto product = [&](const Matrix3Xd& q) -> Matrix3Xd {  // M^-1/2 K M^-1/2 q
    scaled = q * scale.asDiagonal();
    multiply(K, scaled, Kq);
    if (g) Kq += g->cwiseProduct(scaled).sum() * *g;
    filter(forces.constraints, Kq);
    return Kq * scale.asDiagonal();
  };

  Random random(1);
  Matrix3Xd q(3, state.x.cols()), q_before = Matrix3Xd::Zero(3, state.x.cols());
  for (double& c : q.reshaped()) c = random.uniform() - 0.5;
  filter(forces.constraints, q);
  q.normalize();
  constexpr int kMaxIterations = 60;
  constexpr double kTolerance = 1e-3;
  std::vector<double> alpha, beta;
  double largest = 0;
  for (int j = 0; j < kMaxIterations; ++j) {
    Matrix3Xd r = product(q) - (j > 0 ? beta.back() : 0.) * q_before;
    alpha.push_back(r.cwiseProduct(q).sum());
    r -= alpha.back() * q;
    beta.push_back(r.norm());
    const int m = static_cast<int>(alpha.size());
    Eigen::MatrixXd T = Eigen::MatrixXd::Zero(m, m);
    for (int i = 0; i < m; ++i) {
      T(i, i) = alpha[i];
      if (i > 0) T(i, i - 1) = T(i - 1, i) = beta[i - 1];
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ritz(T);
    const double residual = beta.back() * std::abs(ritz.eigenvectors()(m - 1, m - 1));
    largest = ritz.eigenvalues()(m - 1) + residual;  // the Ritz value alone errs on the unstable side
    if (residual <= kTolerance * largest) break;
    q_before = q;
    q = r / beta.back();
  }
  const double c = forces.mass_damping;
  return 4 / (c + std::sqrt(c * c + 4 * largest));
}

}  // namespace testbed
