#include "fem_reference/two_level.h"

#include <deal.II/lac/solver_cg.h>

#include <Eigen/CholmodSupport>
#include <algorithm>
#include <vector>

namespace testbed {

struct TwoLevelSolver::Factor {
  Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>> cholesky;
};

namespace {

/// Anything that maps a vector to a vector, as deal.II's solver wants it.
template <class Apply>
struct Preconditioner {
  const Apply& apply;
  void vmult(DealVector& z, const DealVector& r) const { apply(z, r); }
};

}  // namespace

TwoLevelSolver::TwoLevelSolver(const Nodes& nodes, const Space& fine_space, const Space* coarse_space)
    : nodes_(nodes), fine_(fine_space), coarse_(coarse_space), factor_(std::make_unique<Factor>()) {
  factor_->cholesky.cholmod().print = 0;
}

TwoLevelSolver::~TwoLevelSolver() = default;

bool TwoLevelSolver::factorise(const SystemMatrix& degree_1, bool is_singular) {
  constexpr double kShift = 1e-8;  // of the largest diagonal entry
  const dealii::SparseMatrix<double>& A = degree_1.matrix;
  double shift = 0;
  if (is_singular)
    for (unsigned i = 0; i < A.m(); ++i) shift = std::max(shift, kShift * A.diag_element(i));
  Eigen::SparseMatrix<double> lower(A.m(), A.n());  // column i holds row i right of the diagonal
  lower.reserve(static_cast<Eigen::Index>(A.n_nonzero_elements() / 2 + A.m()));
  std::vector<std::pair<int, double>> column;
  for (unsigned i = 0; i < A.m(); ++i) {
    column.clear();
    for (auto entry = A.begin(i); entry != A.end(i); ++entry)
      if (entry->column() >= i) column.emplace_back(entry->column(), entry->value());
    std::sort(column.begin(), column.end());  // deal.II puts the diagonal first
    lower.startVec(i);
    for (const auto& [row, value] : column)
      lower.insertBack(row, i) = value + (row == static_cast<int>(i) ? shift : 0);
  }
  lower.finalize();
  factor_->cholesky.compute(lower);
  return factor_->cholesky.info() == Eigen::Success;
}

void TwoLevelSolver::apply(const SystemMatrix& fine, DealVector& z, const DealVector& r) const {
  const auto& A = fine.matrix;
  if (!coarse_) {
    Eigen::Map<Eigen::VectorXd>(z.begin(), z.size()) =
        factor_->cholesky.solve(Eigen::Map<const Eigen::VectorXd>(r.begin(), r.size()));
    return;
  }
  // z = SOR r; z += P A_1^-1 P^T (r - A z); z += SOR^T (r - A z): symmetric and positive definite.
  const std::vector<unsigned>&dof = fine_.dof_of, &coarse_dof = coarse_->dof_of;
  const int n = 3 * nodes_.n_vertices;
  DealVector d(r.size());
  Eigen::VectorXd c(n);
  z = r;
  A.SOR(z, 1.0);
  A.residual(d, z, r);
  for (int k = 0; k < n; ++k) c(coarse_dof[k]) = d(dof[k]);
  for (int e = 0; e < nodes_.edges.cols(); ++e)
    for (int k = 0; k < 3; ++k) {
      const double half = d(dof[n + 3 * e + k]) / 2;
      c(coarse_dof[3 * nodes_.edges(0, e) + k]) += half;
      c(coarse_dof[3 * nodes_.edges(1, e) + k]) += half;
    }
  const auto is_held = [&](unsigned i) { return fine.constraints.is_constrained(i); };
  for (int k = 0; k < n; ++k)
    if (is_held(dof[k])) c(coarse_dof[k]) = 0;
  c = factor_->cholesky.solve(c).eval();
  for (int k = 0; k < n; ++k) z(dof[k]) += c(coarse_dof[k]);
  for (int e = 0; e < nodes_.edges.cols(); ++e)
    for (int k = 0; k < 3; ++k)
      if (const unsigned i = dof[n + 3 * e + k]; !is_held(i))
        z(i) += (c(coarse_dof[3 * nodes_.edges(0, e) + k]) + c(coarse_dof[3 * nodes_.edges(1, e) + k])) / 2;
  A.residual(d, z, r);
  A.TSOR(d, 1.0);
  z += d;
}

LinearReport TwoLevelSolver::solve(const SystemMatrix& fine, const Eigen::MatrixXd& rigid,
                                   const DealVector& b, DealVector& x, double tolerance) const {
  LinearReport report;
  DealVector right = b;
  project_out(rigid, right);
  x = 0;
  const double norm = right.l2_norm();
  if (norm == 0) {
    report.is_converged = true;
    return report;
  }
  const auto preconditioned = [&](DealVector& z, const DealVector& r) {
    apply(fine, z, r);
    project_out(rigid, z);
  };
  constexpr unsigned kMaxIterations = 2000;
  dealii::SolverControl control(kMaxIterations, tolerance * norm);
  try {
    dealii::SolverCG<DealVector>(control).solve(fine.matrix, x, right,
                                                Preconditioner<decltype(preconditioned)>{preconditioned});
    report.is_converged = true;
  } catch (const dealii::SolverControl::NoConvergence&) {
    report.is_converged = false;
  }
  report.iterations = static_cast<int>(control.last_step());
  report.residual = control.last_value() / norm;
  project_out(rigid, x);
  return report;
}

void project_out(const Eigen::MatrixXd& columns, DealVector& v) {
  if (columns.cols() == 0) return;
  Eigen::Map<Eigen::VectorXd> flat(v.begin(), v.size());
  flat -= columns * (columns.transpose() * flat).eval();
}

}  // namespace testbed
