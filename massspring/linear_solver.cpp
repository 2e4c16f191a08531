#include "massspring/linear_solver.h"

#include <Eigen/LU>

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

// Counts, not seconds, decide, so that a run repeats itself. On springs applied one by one a factor costs as
// much as some 400 block Jacobi iterations at 1e3 nodes and 1500 at 4e3, a solve with it 15 and 45.
constexpr int kManyIterations = 500;
constexpr int kWornOut = 12;             // iterations at which a factor is made anew
constexpr int kLargestFactored = 30000;  // nodes; beyond, fill outgrows memory and patience
constexpr int kMaxIterations = 5000;

}  // namespace

SolveReport LinearSolver::solve(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance) {
  if (factor_) return solve_by_factor(A, b, x, tolerance);
  A.diagonal(diagonal_);
  for (Eigen::Matrix3d& block : diagonal_) block = block.inverse().eval();
  const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    z.resizeLike(r);
    for (Eigen::Index i = 0; i < r.cols(); ++i) z.col(i).noalias() = diagonal_[i] * r.col(i);
  };
  if (krylov_ == Krylov::BiCgStab) {
    choice_ = "bi-conjugate gradients, block Jacobi: asked for";
    return bi_conjugate_gradients(A.product, precondition, b, x, tolerance, kMaxIterations);
  }
  const SolveReport report = conjugate_gradients(A.product, precondition, b, x, tolerance, kMaxIterations);
  if (report.iterations > kManyIterations) {
    const std::string many = std::to_string(report.iterations) + " iterations";
    const auto n = b.cols();
    if (n > kLargestFactored) {
      choice_ = "block Jacobi: " + many + ", but " + std::to_string(n) + " nodes are too many to factorise";
    } else if (factor_ = std::make_unique<BlockCholesky>(A.matrix()); factor_->is_ok()) {
      choice_ = "Cholesky factor of an earlier matrix: block Jacobi took " + many;
    } else {
      factor_.reset();
    }
  }
  return report;
}

SolveReport LinearSolver::solve_by_factor(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                                          double tolerance) {
  const SolveReport report = conjugate_gradients(
      A.product, [&](const Matrix3Xd& r, Matrix3Xd& z) { factor_->solve(r, z); }, b, x, tolerance,
      kMaxIterations);
  if (report.iterations > kWornOut) {
    factor_->update(A.matrix());
    if (!factor_->is_ok()) factor_.reset();
  }
  return report;
}

}  // namespace testbed
