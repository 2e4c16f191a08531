#include "fem_reference/solid/dynamics.h"

#include <Spectra/MatOp/SparseSymMatProd.h>
#include <Spectra/SymGEigsShiftSolver.h>

#include <Eigen/CholmodSupport>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace testbed::fem {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Cholesky = Eigen::CholmodSupernodalLLT<Sparse>;

/// Whether A is positive definite.
bool factorise(const Sparse& A, Cholesky& factor) {
  factor.cholmod().print = 0;
  factor.compute(A);
  return factor.info() == Eigen::Success;
}

[[noreturn]] void refuse_indefinite() {
  throw std::runtime_error("the matrix is not positive definite, expected sound tetrahedra and mass");
}

/// (K - sigma M)^-1 as Spectra asks for it.
class ShiftInvert {
 public:
  using Scalar = double;
  ShiftInvert(const Sparse& K, const Sparse& M) : K_(K), M_(M) {}
  Eigen::Index rows() const { return K_.rows(); }
  Eigen::Index cols() const { return K_.cols(); }
  void set_shift(double sigma) {
    if (!factorise(K_ - sigma * M_, factor_)) refuse_indefinite();
  }
  void perform_op(const double* x, double* y) const {
    Eigen::Map<Eigen::VectorXd>(y, rows()) = factor_.solve(Eigen::Map<const Eigen::VectorXd>(x, rows()));
  }

 private:
  const Sparse &K_, &M_;
  Cholesky factor_;
};

/// Rows and columns `keep` of A.
Sparse restricted(const Sparse& A, const std::vector<int>& keep) {
  std::vector<int> place(A.rows(), -1);
  for (size_t i = 0; i < keep.size(); ++i) place[keep[i]] = static_cast<int>(i);
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < A.outerSize(); ++j)
    for (Sparse::InnerIterator entry(A, j); entry; ++entry)
      if (place[entry.row()] >= 0 && place[j] >= 0)
        entries.emplace_back(place[entry.row()], place[j], entry.value());
  const auto n = static_cast<Eigen::Index>(keep.size());
  Sparse part(n, n);
  part.setFromTriplets(entries.begin(), entries.end());
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
  constexpr double kShift = 1e-8, kZero = 1e-6;
  const double highest = (K.diagonal().array() / M.diagonal().array()).maxCoeff();
  ShiftInvert inverse(K, M);
  Spectra::SparseSymMatProd<double> mass(M);
  const int n_krylov = std::min<int>(static_cast<int>(K.rows()), std::max(2 * n + 10, 30));
  Spectra::SymGEigsShiftSolver<ShiftInvert, Spectra::SparseSymMatProd<double>,
                               Spectra::GEigsMode::ShiftInvert>
      solver(inverse, mass, n, n_krylov, -kShift * highest);
  solver.init();
  solver.compute(Spectra::SortRule::LargestMagn, 1000, 1e-10, Spectra::SortRule::SmallestAlge);
  if (solver.info() != Spectra::CompInfo::Successful)
    throw std::runtime_error("natural frequencies: the Lanczos iteration has not converged");
  const Eigen::VectorXd squared = solver.eigenvalues();
  Modes modes{Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Zero(stiffness.rows(), n), 0};
  modes.shape(free, Eigen::all) = solver.eigenvectors();
  for (int k = 0; k < n; ++k) {
    if (squared(k) < kZero * kShift * highest + 1e-6 * squared(n - 1)) {
      ++modes.n_rigid;
    } else {
      modes.frequency(k) = std::sqrt(squared(k)) / (2 * M_PI);
    }
  }
  return modes;
}

struct TimeIntegrator::Factor {
  Cholesky cholesky;
};

TimeIntegrator::TimeIntegrator(Dynamics system, double h, const TimeScheme& scheme)
    : Motion(std::move(system), h), scheme_(scheme), factor_(std::make_unique<Factor>()) {
  const auto n = system_.K.rows();
  find_free();
  restart(Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n));
}

void TimeIntegrator::find_free() {
  free_ = all_but(system_.held, system_.K.rows());
  if (!factorise(system_.K)) refuse_indefinite();
}

TimeIntegrator::~TimeIntegrator() = default;

Linearisation Motion::respond(const Eigen::VectorXd& u, bool with_tangent) const {
  if (system_.linearise) return system_.linearise(u, with_tangent);
  const Eigen::VectorXd force = system_.K * u;
  return {force, {}, u.dot(force) / 2};
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
  return fem::factorise(restricted(A, free_), factor_->cholesky);
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
  f_ = respond(u_, false).force;
  Cholesky mass;
  if (!fem::factorise(restricted(system_.M, free_), mass)) refuse_indefinite();
  const Eigen::VectorXd residual = system_.load - system_.M * (a_ + system_.damping * v_).eval() - f_ -
                                   system_.stiffness_damping * (system_.K * v_);
  a_(free_) = mass.solve(residual(free_).eval()).eval();
}

bool TimeIntegrator::step() {
  const auto& [alpha_m, alpha_f, beta, gamma] = scheme_;
  const bool is_linear = !system_.linearise;
  constexpr double kTolerance = 1e-9, kRounding = 1e-6, kSlow = 0.1;
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
        system_.K * ((1 - alpha_f) * u + alpha_f * u_ + system_.stiffness_damping * velocity).eval();
    a(free_) += factor_->cholesky.solve(residual(free_).eval());
    follow();
  }
  bool is_new = false;
  double before = std::numeric_limits<double>::infinity();
  for (int iteration = 0; !is_linear; ++iteration, ++n_newton_iterations_, follow()) {
    if (iteration == kMaxIterations) return false;
    Linearisation response = respond(u, false);
    if (!std::isfinite(response.energy)) {
      a = ((a + sound) / 2).eval();
      continue;
    }
    sound = a;
    const Eigen::VectorXd M_a = inertia(), residual = (system_.load - M_a - (1 - alpha_f) * response.force -
                                                       alpha_f * f_)(free_);
    const double size = system_.load.norm() + M_a.norm() + response.force.norm(), error = residual.norm();
    const bool is_slow = error > kSlow * before;
    if (error <= kTolerance * size || (is_new && is_slow && error <= kRounding * size)) {
      f_ = std::move(response.force);
      break;
    }
    is_new = is_slow;
    if (is_new && !factorise(respond(u, true).tangent)) return false;
    before = error;
    a(free_) += factor_->cholesky.solve(residual);
  }
  u_.swap(u);
  v_.swap(v);
  a_.swap(a);
  ++n_steps_;
  return true;
}

}  // namespace testbed::fem
