#include "fem_reference/solid/dynamics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include "meshing/algebra/lowest_modes.h"
#include "meshing/scene/scene.h"

namespace testbed::fem {
namespace {

using meshing::SparseCholesky;
using Sparse = Eigen::SparseMatrix<double>;

[[noreturn]] void refuse_indefinite() {
  throw std::runtime_error("the matrix is not positive definite, expected sound tetrahedra and mass");
}

/// The lower triangle of rows and columns `keep` (ascending) of A.
Sparse restricted(const Sparse& A, const std::vector<int>& keep) {
  std::vector<int> place(A.rows(), -1);
  for (size_t i = 0; i < keep.size(); ++i) place[keep[i]] = static_cast<int>(i);
  const auto n = static_cast<Eigen::Index>(keep.size());
  Sparse part(n, n);
  part.reserve(A.nonZeros() / 2 + n);
  for (int j = 0; j < n; ++j) {
    part.startVec(j);
    for (Sparse::InnerIterator entry(A, keep[j]); entry; ++entry)
      if (place[entry.row()] >= j) part.insertBack(place[entry.row()], j) = entry.value();
  }
  part.finalize();
  return part;
}

std::vector<int> all_but(const std::vector<int>& held, Eigen::Index n) {
  std::vector<bool> is_held(n, false);
  for (int i : held) is_held[i] = true;
  std::vector<int> rest;
  for (int i = 0; i < n; ++i)
    if (!is_held[i]) rest.push_back(i);
  return rest;
}

}  // namespace

Modes natural_modes(const Sparse& stiffness, const Sparse& full_mass, const std::vector<int>& held, int n) {
  const std::vector<int> free = all_but(held, stiffness.rows());
  const Sparse K = restricted(stiffness, free), M = restricted(full_mass, free);
  // Far below the first elastic eigenvalue, far above rounding.
  constexpr double kShift = 1e-8, kZero = 1e-12;
  const double highest = (K.diagonal().array() / M.diagonal().array()).maxCoeff();
  const SparseCholesky factor(K + kShift * highest * M);
  if (!factor.is_ok()) refuse_indefinite();
  using Eigen::MatrixXd;
  const LowestModes found =
      lowest_modes({[&](const MatrixXd& x) -> MatrixXd { return K.selfadjointView<Eigen::Lower>() * x; },
                    [&](const MatrixXd& x) -> MatrixXd { return M.selfadjointView<Eigen::Lower>() * x; },
                    [&](const MatrixXd& x) -> MatrixXd { return factor.solve(x); }, K.rows(), kZero* highest},
                   n);
  Modes modes{found.eigenvalue.cwiseSqrt() / (2 * M_PI), MatrixXd::Zero(stiffness.rows(), found.shape.cols()),
              found.n_zero};
  modes.shape(free, Eigen::all) = found.shape;
  return modes;
}

TimeIntegrator::TimeIntegrator(Dynamics system, double h, const TimeScheme& scheme)
    : Motion(std::move(system), h), scheme_(scheme) {
  const auto n = system_.K.rows();
  find_free();
  restart(Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n));
}

std::string TimeIntegrator::solver() const {
  const bool is_newmark = scheme_.alpha_m == 0 && scheme_.alpha_f == 0;
  return std::string(is_newmark ? "Newmark (average acceleration)" : "generalised-alpha") +
         (system_.linearise ? ", Newton" : "") + ", Cholesky";
}

std::unique_ptr<Motion> make_generalised_alpha(Dynamics system, double h, const ReferenceOptions& options) {
  const auto& radius = options.spectral_radius;
  return std::make_unique<TimeIntegrator>(std::move(system), h,
                                          radius ? generalised_alpha(*radius) : kNewmark);
}

void TimeIntegrator::find_free() {
  free_ = all_but(system_.held, system_.K.rows());
  factor_.reset();
  if (!factorise(system_.K)) refuse_indefinite();
}

Linearisation Motion::respond(const Eigen::VectorXd& u, bool with_tangent) const {
  if (system_.linearise) return system_.linearise(u, with_tangent);
  const Eigen::VectorXd force = system_.K * u;
  return {force, {}, u.dot(force) / 2};
}

Eigen::VectorXd Motion::force_of(const Eigen::VectorXd& u) const {
  if (!system_.forces) return respond(u, false).force;
  Eigen::Matrix3Xd force;
  system_.forces(u, force);
  return force.reshaped();
}

Motion::HeldState Motion::held_at(double t) const {
  if (!system_.held_motion) {
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(system_.held.size()));
    return {u_(system_.held), zero, zero};
  }
  const Eigen::VectorXd before = system_.held_motion(t - h_), now = system_.held_motion(t),
                        after = system_.held_motion(t + h_);
  return {now, (after - before) / (2 * h_), (after - 2 * now + before) / (h_ * h_)};
}

/// Of the step's system for its acceleration.
bool TimeIntegrator::factorise(const Sparse& tangent) {
  const auto& [alpha_m, alpha_f, beta, gamma] = scheme_;
  Sparse A = ((1 - alpha_m) + (1 - alpha_f) * gamma * h_ * system_.damping) * system_.M +
             (1 - alpha_f) * beta * h_ * h_ * tangent;
  if (system_.stiffness_damping > 0) A += (1 - alpha_f) * gamma * h_ * system_.stiffness_damping * system_.K;
  ++n_factorisations_;
  const Sparse lower = restricted(A, free_);
  if (factor_)
    factor_->update(lower);
  else
    factor_.emplace(lower);
  if (!factor_->is_ok()) return false;
  if (system_.linearise) rounded_ = factor_->rounded();
  return true;
}

void Motion::hold(const std::vector<int>& held, std::function<Eigen::VectorXd(double t)> motion) {
  system_.held = held;
  system_.held_motion = std::move(motion);
  find_free();
  const Eigen::VectorXd u = u_, v = v_;
  go_on(u, v);
}

Motion::HeldState Motion::start_at(const Eigen::VectorXd& u, const Eigen::VectorXd& v) {
  u_ = u;
  v_ = v;
  HeldState held = held_at(t());
  u_(system_.held) = held.u;
  v_(system_.held) = held.v;
  return held;
}

void TimeIntegrator::go_on(const Eigen::VectorXd& u, const Eigen::VectorXd& v) {
  const HeldState held = start_at(u, v);
  a_ = Eigen::VectorXd::Zero(u.size());
  a_(system_.held) = held.a;
  f_ = force_of(u_);
  const SparseCholesky mass(restricted(system_.M, free_));
  if (!mass.is_ok()) refuse_indefinite();
  const Eigen::VectorXd residual = system_.load - system_.M * (a_ + system_.damping * v_).eval() - f_ -
                                   system_.stiffness_damping * (system_.K * v_);
  a_(free_) = mass.solve(residual(free_).eval()).eval();
}

/// What the factor in single precision makes of r.
Eigen::VectorXd TimeIntegrator::solve_rounded(const Eigen::VectorXd& r) const {
  Eigen::Matrix3Xd field = Eigen::Matrix3Xd::Zero(3, (r.size() + 2) / 3);
  field.reshaped().head(r.size()) = r;
  return rounded_.solve(field).reshaped().head(r.size());
}

bool TimeIntegrator::step() {
  const auto& [alpha_m, alpha_f, beta, gamma] = scheme_;
  const bool is_linear = !system_.linearise;
  constexpr double kRounding = 1e-6, kSlow = 0.3;
  constexpr int kMaxIterations = 50;
  const HeldState held = held_at(t() + h_);
  // Free unknowns that stay where they are strain the body no more than it is.
  Eigen::VectorXd sound = -(v_ / h_ + (0.5 - beta) * a_) / beta, a = a_, u, v, velocity;
  a(system_.held) = sound(system_.held) = held.a;
  const auto follow = [&] {
    u = u_ + h_ * v_ + h_ * h_ * ((0.5 - beta) * a_ + beta * a);
    v = v_ + h_ * ((1 - gamma) * a_ + gamma * a);
    u(system_.held) = held.u;
    v(system_.held) = held.v;
    velocity = (1 - alpha_f) * v + alpha_f * v_;
  };
  const auto inertia = [&]() -> Eigen::VectorXd {
    return system_.M * ((1 - alpha_m) * a + alpha_m * a_ + system_.damping * velocity).eval();
  };
  follow();
  if (is_linear) {
    const Eigen::VectorXd residual =
        system_.load - inertia() -
        force_of((1 - alpha_f) * u + alpha_f * u_ + system_.stiffness_damping * velocity);
    a(free_) += factor_->solve(residual(free_).eval());
    follow();
  }
  bool is_new = false;
  double before = std::numeric_limits<double>::infinity();
  for (int iteration = 0; !is_linear; ++iteration, ++n_newton_iterations_, follow()) {
    if (iteration == kMaxIterations) return false;
    Eigen::VectorXd f = force_of(u);
    const double f_size = f.norm();
    if (!std::isfinite(f_size)) {
      a = ((a + sound) / 2).eval();
      continue;
    }
    const Eigen::VectorXd M_a = inertia(),
                          residual = (system_.load - M_a - (1 - alpha_f) * f - alpha_f * f_)(free_);
    const double size = system_.load.norm() + M_a.norm() + f_size, error = residual.norm();
    const bool is_slow = error > kSlow * before;
    if (error <= system_.tolerance * size || (is_new && is_slow && error <= kRounding * size)) {
      f_ = std::move(f);
      break;
    }
    sound = a;
    is_new = is_slow;
    if (is_new && !factorise(respond(u, true).tangent)) return false;
    before = error;
    a(free_) += solve_rounded(residual);
  }
  u_.swap(u);
  v_.swap(v);
  a_.swap(a);
  ++n_steps_;
  return true;
}

}  // namespace testbed::fem
