#include "massspring/algebra/linear_solver.h"

#include <Eigen/LU>

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

// Counts, not seconds, decide, so that a run repeats itself. On springs applied one by one a factor of n
// nodes costs as much as some 0.4 n block Jacobi iterations, a solve with it 0.01 n. An iteration with
// multigrid costs as much as 5 with block Jacobi where nodes exceed the caches, 8 where not.
constexpr int kLargestFactored = 30000;  // nodes; beyond, fill outgrows memory and patience
constexpr int kSmallest = 500;           // nodes from which on single precision is faster
constexpr int kManyLarge = 100;
constexpr double kFactor = 0.4, kFactorSolve = 0.01;
constexpr int kWornOut = 12;  // iterations at which a factor is made anew
constexpr int kMaxIterations = 5000, kMaxMultigrid = 1000;

}  // namespace

/// Iterative refinement: the residual in double precision, corrections to it in single.
template <class Precondition>
SolveReport LinearSolver::refine(const LinearSystem& A, const Precondition& precondition, const Matrix3Xd& b,
                                 Matrix3Xd& x, double tolerance, int max_iterations) {
  constexpr double kDeepest = 1e-5, kBelow = 0.9, kLost = 0.5, kRounding = 1e-5;
  SolveReport report;
  const double b_norm = b.norm();
  Matrix3Xd r, Ax;
  PaddedField rounded, correction;
  const auto measure = [&] {
    A.product(x, Ax);
    r = b - Ax;
    report.residual = b_norm > 0 ? r.norm() / b_norm : r.norm();
    report.is_converged = report.residual <= tolerance;
  };
  measure();
  while (!report.is_converged && report.iterations < max_iterations) {
    const double before = report.residual, size = r.norm();
    pad(r, 1 / size, rounded);
    correction.setZero(4, rounded.cols());
    const SolveReport inner = conjugate_gradients(A.rounded_product, precondition, rounded, 1, correction,
                                                  std::max(kDeepest, kBelow * tolerance / before),
                                                  max_iterations - report.iterations);
    report.iterations += inner.iterations;
    add_unpadded(correction, size, x);
    measure();
    if (report.is_converged || inner.curvature < -kRounding) break;
    const bool is_as_foreseen = inner.iterations > 0 && report.residual <= 2 * inner.residual * before;
    if (!(report.residual <= kLost * before || is_as_foreseen)) {
      is_single_enough_ = false;
      add_unpadded(correction, -size, x);
      break;
    }
  }
  return report;
}

SolveReport LinearSolver::solve(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance) {
  if (factor_) return solve_by_factor(A, b, x, tolerance);
  A.diagonal(inverse_);
  for (Eigen::Matrix3d& block : inverse_) block = block.inverse().eval();
  const auto jacobi = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    z.resizeLike(r);
    for (Eigen::Index i = 0; i < r.cols(); ++i) z.col(i).noalias() = inverse_[i] * r.col(i);
  };
  if (is_multigrid_chosen_) return solve_by_multigrid(A, b, x, tolerance);
  if (krylov_ == Krylov::BiCgStab) {
    choice_ = "bi-conjugate gradients, block Jacobi: asked for";
    return bi_conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations);
  }
  const bool is_large = b.cols() > kLargestFactored;
  const int many = is_large ? kManyLarge : patience_;
  SolveReport first;
  const bool is_single = is_single_enough_ && b.cols() >= kSmallest;
  if (is_single) {
    rounded_inverse_ = pad(inverse_);
    const auto rounded_jacobi = [&](const PaddedField& r, PaddedField& z) {
      return multiply(rounded_inverse_, r, z);
    };
    first = refine(A, rounded_jacobi, b, x, tolerance, many);
  }
  int n_before = 0;
  const bool is_hard = is_single && !first.is_converged && first.iterations >= many;
  if (!is_single || !is_single_enough_ || (is_hard && !is_large)) {
    n_before = first.iterations;
    first = conjugate_gradients(A.product, jacobi, b, x, tolerance, many);
    if (is_hard && first.is_converged) is_single_enough_ = false;
  }
  const bool is_done = first.is_converged || first.iterations < many;
  first.iterations += n_before;
  if (is_done) return first;

  SolveReport rest;
  const std::string why = ": block Jacobi took more than " + std::to_string(many) + " iterations";
  if (is_large) {
    is_multigrid_chosen_ = true;
    choice_ = "multigrid" + why + ", and " + std::to_string(b.cols()) + " nodes are too many to factorise";
    rest = solve_by_multigrid(A, b, x, tolerance);
  } else if (factor_ = std::make_unique<BlockCholesky>(A.matrix()); factor_->is_ok()) {
    choice_ = "Cholesky factor of an earlier matrix" + why;
    rest = solve_by_factor(A, b, x, tolerance);
  } else {
    factor_.reset();
    rest = conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations);
  }
  rest.iterations += first.iterations;
  return rest;
}

SolveReport LinearSolver::solve_by_factor(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                                          double tolerance) {
  const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    factor_->solve(r, z);
    A.filter(z);  // constraints may have come since
  };
  const SolveReport report = conjugate_gradients(A.product, precondition, b, x, tolerance, kMaxIterations);
  if (report.iterations > kWornOut) {
    const int cost = static_cast<int>((kFactor + kFactorSolve * report.iterations) * b.cols());
    const bool is_worth_it = cost <= patience_;
    if (is_worth_it) factor_->update(A.matrix());
    if (!is_worth_it || !factor_->is_ok()) {
      factor_.reset();
      choice_ = "block Jacobi: a Cholesky factor wears out too soon";
    }
    patience_ = std::max(patience_, cost);
  }
  return report;
}

SolveReport LinearSolver::solve_by_multigrid(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                                             double tolerance) {
  const bool is_new = !multigrid_;
  if (is_new) multigrid_ = std::make_unique<Multigrid>(A, inverse_);
  multigrid_->set_smoother(inverse_);
  const auto precondition = [&](const PaddedField& r, PaddedField& z) { return multigrid_->apply(A, r, z); };
  const auto widened = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    const double size = r.norm();
    PaddedField rounded_r, rounded_z;
    pad(r, size > 0 ? 1 / size : 1, rounded_r);
    precondition(rounded_r, rounded_z);
    z = Matrix3Xd::Zero(3, r.cols());
    add_unpadded(rounded_z, size, z);
  };
  SolveReport report;
  if (is_single_enough_) report = refine(A, precondition, b, x, tolerance, kMaxMultigrid);
  if (!is_single_enough_) report = conjugate_gradients(A.product, widened, b, x, tolerance, kMaxMultigrid);
  if (is_new) first_iterations_ = report.iterations;
  constexpr int kMore = 15;  // iterations that cost as much as making it anew
  if (!report.is_converged || report.iterations > first_iterations_ + kMore) multigrid_.reset();
  return report;
}

}  // namespace testbed::massspring
