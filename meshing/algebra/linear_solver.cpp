#include "meshing/algebra/linear_solver.h"

#include <Eigen/LU>

namespace testbed::meshing {
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

void set_inverse_diagonal(const LinearSystem& A, std::vector<Eigen::Matrix3d>& inverse) {
  A.diagonal(inverse);
  for (Eigen::Matrix3d& block : inverse) block = block.inverse().eval();
}

/// Multigrid on a system in either precision; its own is single.
struct OfSystem {
  Multigrid& multigrid;
  const LinearSystem& A;

  double operator()(const PaddedField& r, PaddedField& z) const {
    multigrid.apply(r, z);
    A.rounded_filter(z);  // constraints may have come since
    return dot(r, z);
  }
  void operator()(const Matrix3Xd& r, Matrix3Xd& z) const {
    const double size = r.norm();
    PaddedField rounded_r, rounded_z;
    pad(r, size > 0 ? 1 / size : 1, rounded_r);
    (*this)(rounded_r, rounded_z);
    z = Matrix3Xd::Zero(3, r.cols());
    add_unpadded(rounded_z, size, z);
  }
};

}  // namespace

void LinearSolver::BlockJacobi::operator()(const Matrix3Xd& r, Matrix3Xd& z) const {
  z.resizeLike(r);
  for (Eigen::Index i = 0; i < r.cols(); ++i) z.col(i).noalias() = inverse[i] * r.col(i);
}

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

/// In single precision where that serves, else, or where it is spent without success, in double.
template <class Precondition>
SolveReport LinearSolver::iterate(const LinearSystem& A, const Precondition& precondition, const Matrix3Xd& b,
                                  Matrix3Xd& x, double tolerance, int max_iterations, int& n) {
  bool is_spent = false;
  if (is_single_enough_ && b.cols() >= kSmallest) {
    const SolveReport single = refine(A, precondition, b, x, tolerance, max_iterations);
    n += single.iterations;
    is_spent = !single.is_converged && single.iterations >= max_iterations && b.cols() <= kLargestFactored;
    if (is_single_enough_ && !is_spent) return single;
  }
  const SolveReport report = conjugate_gradients(A.product, precondition, b, x, tolerance, max_iterations);
  n += report.iterations;
  if (is_spent && report.is_converged) is_single_enough_ = false;
  return report;
}

SolveReport LinearSolver::solve(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance) {
  int n = 0;
  SolveReport report = solve_on(A, b, x, tolerance, n);
  report.iterations = n;
  return report;
}

SolveReport LinearSolver::solve_on(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance,
                                   int& n) {
  return std::visit([&](auto& with) { return solve_with(with, A, b, x, tolerance, n); }, preconditioner_);
}

SolveReport LinearSolver::solve_with(BlockJacobi& jacobi, const LinearSystem& A, const Matrix3Xd& b,
                                     Matrix3Xd& x, double tolerance, int& n) {
  set_inverse_diagonal(A, jacobi.inverse);
  if (krylov_ == Krylov::BiCgStab) {
    choice_ = "bi-conjugate gradients, block Jacobi: asked for";
    const SolveReport report = bi_conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations);
    n += report.iterations;
    return report;
  }
  jacobi.rounded = pad(jacobi.inverse);
  const bool is_large = b.cols() > kLargestFactored;
  const int many = is_large ? kManyLarge : patience_;
  const SolveReport first = iterate(A, jacobi, b, x, tolerance, many, n);
  if (first.is_converged || first.iterations < many) return first;

  const std::string why = ": block Jacobi took more than " + std::to_string(many) + " iterations";
  if (is_large) {
    choice_ = "multigrid" + why + ", and " + std::to_string(b.cols()) + " nodes are too many to factorise";
    preconditioner_ = RigidGroups{};
  } else if (auto factor = std::make_unique<BlockCholesky>(A.matrix()); factor->is_ok()) {
    choice_ = "Cholesky factor of an earlier matrix" + why;
    preconditioner_ = std::move(factor);
  } else {
    const SolveReport rest = conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations);
    n += rest.iterations;
    return rest;
  }
  return solve_on(A, b, x, tolerance, n);
}

SolveReport LinearSolver::solve_with(Factor& factor, const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                                     double tolerance, int& n) {
  const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    factor->solve(r, z);
    A.filter(z);  // constraints may have come since
  };
  const SolveReport report = conjugate_gradients(A.product, precondition, b, x, tolerance, kMaxIterations);
  n += report.iterations;
  if (report.iterations > kWornOut) {
    const int cost = static_cast<int>((kFactor + kFactorSolve * report.iterations) * b.cols());
    const bool is_worth_it = cost <= patience_;
    if (is_worth_it) factor->update(A.matrix());
    if (!is_worth_it || !factor->is_ok()) {
      preconditioner_ = BlockJacobi{};
      choice_ = "block Jacobi: a Cholesky factor wears out too soon";
    }
    patience_ = std::max(patience_, cost);
  }
  return report;
}

SolveReport LinearSolver::solve_with(RigidGroups& groups, const LinearSystem& A, const Matrix3Xd& b,
                                     Matrix3Xd& x, double tolerance, int& n) {
  const bool is_new = !groups.multigrid;
  if (is_new) groups.multigrid = std::make_unique<Multigrid>(A.matrix(), *A.positions, A.filter);
  const SolveReport report = iterate(A, OfSystem{*groups.multigrid, A}, b, x, tolerance, kMaxMultigrid, n);
  if (is_new) groups.first_iterations = report.iterations;
  constexpr int kMore = 15;  // iterations that cost as much as making it anew
  if (!report.is_converged || report.iterations > groups.first_iterations + kMore) groups.multigrid.reset();
  return report;
}

}  // namespace testbed::meshing
