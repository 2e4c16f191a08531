#include "massspring/linear_solver.h"

#include <Eigen/LU>

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

// Counts, not seconds, decide, so that a run repeats itself. On springs applied one by one a factor costs as
// much as some 400 block Jacobi iterations at 1e3 nodes and 1500 at 4e3, a solve with it 15 and 45. An
// iteration with multigrid costs as much as 5 with block Jacobi where nodes exceed the caches, 8 where not.
constexpr int kLargestFactored = 30000;  // nodes; beyond, fill outgrows memory and patience
constexpr int kMany = 500, kManyLarge = 100;
constexpr int kWornOut = 12;  // iterations at which a factor is made anew
constexpr int kMaxIterations = 5000, kMaxMultigrid = 1000;

}  // namespace

SolveReport LinearSolver::solve(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance) {
  if (factor_) return solve_by_factor(A, b, x, tolerance);
  A.diagonal(inverse_);
  for (Eigen::Matrix3d& block : inverse_) block = block.inverse().eval();
  if (is_multigrid_chosen_) return solve_by_multigrid(A, b, x, tolerance);
  const auto jacobi = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    z.resizeLike(r);
    for (Eigen::Index i = 0; i < r.cols(); ++i) z.col(i).noalias() = inverse_[i] * r.col(i);
  };
  if (krylov_ == Krylov::BiCgStab) {
    choice_ = "bi-conjugate gradients, block Jacobi: asked for";
    return bi_conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations);
  }
  const bool is_large = b.cols() > kLargestFactored;
  const int many = is_large ? kManyLarge : kMany;
  const SolveReport first = conjugate_gradients(A.product, jacobi, b, x, tolerance, many);
  if (first.is_converged || first.iterations < many) return first;

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
    factor_->update(A.matrix());
    if (!factor_->is_ok()) factor_.reset();
  }
  return report;
}

SolveReport LinearSolver::solve_by_multigrid(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                                             double tolerance) {
  const bool is_new = !multigrid_;
  if (is_new) multigrid_ = std::make_unique<Multigrid>(A, inverse_);
  const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) { multigrid_->apply(A, inverse_, r, z); };
  const SolveReport report = conjugate_gradients(A.product, precondition, b, x, tolerance, kMaxMultigrid);
  if (is_new) first_iterations_ = report.iterations;
  constexpr int kMore = 15;  // iterations that cost as much as making it anew
  if (!report.is_converged || report.iterations > first_iterations_ + kMore) multigrid_.reset();
  return report;
}

}  // namespace testbed
