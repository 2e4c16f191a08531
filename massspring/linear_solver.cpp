#include "massspring/linear_solver.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

// Counts, not seconds, decide, so that a run repeats itself. A factor costs as much as some 900 block Jacobi
// iterations at 1e3 nodes and 2000 at 1e4, a solve with it 10 and 40; kept for ten steps it pays beyond some
// hundreds of iterations a step.
constexpr int kManyIterations = 200;
constexpr int kWornOut = 12;             // iterations at which a factor is made anew
constexpr int kLargestFactored = 30000;  // nodes; beyond, fill outgrows memory and patience
constexpr int kMaxIterations = 5000;

auto product_with(const BlockMatrix& A, const std::optional<Matrix3Xd>& g) {
  return [&](const Matrix3Xd& p, Matrix3Xd& y) {
    multiply(A, p, y);
    if (g) y += g->cwiseProduct(p).sum() * *g;
  };
}

}  // namespace

SolveReport LinearSolver::solve(const BlockMatrix& A, const std::optional<Matrix3Xd>& g, const Matrix3Xd& b,
                                Matrix3Xd& x, double tolerance) {
  if (factor_) return solve_by_factor(A, g, b, x, tolerance);
  block_jacobi(A, inverse_diagonal_);
  const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    z.resizeLike(r);
    for (Eigen::Index i = 0; i < r.cols(); ++i) z.col(i).noalias() = inverse_diagonal_[i] * r.col(i);
  };
  const SolveReport report =
      conjugate_gradients(product_with(A, g), precondition, b, x, tolerance, kMaxIterations);
  if (report.iterations > kManyIterations) {
    const std::string many = std::to_string(report.iterations) + " iterations";
    if (A.rows() > kLargestFactored) {
      choice_ =
          "block Jacobi: " + many + ", but " + std::to_string(A.rows()) + " nodes are too many to factorise";
    } else if (factor_ = std::make_unique<BlockCholesky>(A); factor_->is_ok()) {
      choice_ = "Cholesky factor of an earlier matrix: block Jacobi took " + many;
    } else {
      factor_.reset();
    }
  }
  return report;
}

SolveReport LinearSolver::solve_by_factor(const BlockMatrix& A, const std::optional<Matrix3Xd>& g,
                                          const Matrix3Xd& b, Matrix3Xd& x, double tolerance) {
  const SolveReport report = conjugate_gradients(
      product_with(A, g), [&](const Matrix3Xd& r, Matrix3Xd& z) { factor_->solve(r, z); }, b, x, tolerance,
      kMaxIterations);
  if (report.iterations > kWornOut) {
    factor_ = std::make_unique<BlockCholesky>(A);
    if (!factor_->is_ok()) factor_.reset();
  }
  return report;
}

}  // namespace testbed
