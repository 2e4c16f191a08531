#include "fem_reference/solvers/two_level.h"

#include <Eigen/CholmodSupport>
#include <optional>
#include <vector>

#include "fem_reference/base/rigid.h"
#include "fem_reference/solvers/amg.h"
#include "fem_reference/solvers/conjugate_gradients.h"

namespace testbed::fem {
namespace {

using Eigen::VectorXd;
using Rows = SystemMatrix::Rows;

constexpr int kLargestCholesky = 30000;  // unknowns of degree 1; multigrid is faster beyond
constexpr int kLargestDirect = 100000;   // unknowns of degree 2 whose factor takes seconds and a gigabyte
constexpr int kPatience = 120;  // iterations worth a direct factor: four times those on good tetrahedra
constexpr int kMaxIterations = 2000;
constexpr int kRefinements = 10;  // with a factor of the whole matrix: more gain nothing beyond rounding
/// Of the diagonal, where rigid motions are free; the larger ones where a body out of balance would turn.
constexpr double kShifts[] = {1e-8, 1e-4, 1e-2};

Rows shifted(Rows lower, double shift) {
  for (int i = 0; i < lower.rows(); ++i) lower.valuePtr()[lower.outerIndexPtr()[i + 1] - 1] *= 1 + shift;
  return lower;
}

/// Sparse Cholesky, its symbolic part kept.
class Cholesky {
 public:
  bool factorise(const Rows& lower, bool is_singular) {
    if (!is_singular) return factorise(lower);
    for (double shift : kShifts)
      if (factorise(shifted(lower, shift))) return true;
    return false;
  }
  VectorXd solve(const VectorXd& b) const { return factor_.solve(b); }

 private:
  bool factorise(const Rows& lower) {
    const Eigen::SparseMatrix<double> upper = lower.transpose();
    if (!is_analysed_) {
      factor_.cholmod().print = 0;
      factor_.analyzePattern(upper);
      is_analysed_ = true;
    }
    factor_.factorize(upper);
    return factor_.info() == Eigen::Success;
  }

  Eigen::CholmodSupernodalLLT<Eigen::SparseMatrix<double>, Eigen::Upper> factor_;
  bool is_analysed_ = false;
};

}  // namespace

struct TwoLevelSolver::Levels {
  const Nodes& nodes;
  const Space& fine_space;
  const Space* coarse_space;
  Cholesky cholesky;  // of degree 1
  std::unique_ptr<AlgebraicMultigrid> multigrid;
  std::optional<Cholesky> direct;  // of degree 2
  bool is_ready = false;
  int n_iterations = 0;  // of the first solve with the present factor

  bool factorise(const SystemMatrix& fine, const SystemMatrix& degree_1, bool is_singular) {
    is_ready = false;
    if (direct) return is_ready = direct->factorise(fine.lower, is_singular);
    if (degree_1.lower.rows() <= kLargestCholesky)
      return is_ready = cholesky.factorise(degree_1.lower, is_singular);
    const Space& space = coarse_space ? *coarse_space : fine_space;
    const Eigen::MatrixXd by_node = rigid_motions(nodes.X.leftCols(nodes.n_vertices));
    Eigen::MatrixXd motions(by_node.rows(), 6);
    for (int k = 0; k < motions.rows(); ++k) motions.row(space.dof_of[k]) = by_node.row(k);
    multigrid.reset();
    multigrid = std::make_unique<AlgebraicMultigrid>(
        is_singular ? shifted(degree_1.lower, kShifts[0]) : degree_1.lower, std::move(motions));
    return is_ready = true;
  }

  VectorXd solve_degree_1(const VectorXd& r) const {
    return multigrid ? multigrid->apply(r) : cholesky.solve(r);
  }

  VectorXd apply(const SystemMatrix& fine, const VectorXd& r) const {
    if (direct) return direct->solve(r);
    return coarse_space ? cycle(fine, r) : solve_degree_1(r);
  }

  /// z = (D + L)^-1 r; z += P A_1^-1 P^T (r - A z);
  /// z += (D + L)^-T (r - A z): symmetric and positive definite.
  VectorXd cycle(const SystemMatrix& fine, const VectorXd& r) const {
    const std::vector<unsigned>&dof = fine_space.dof_of, &coarse_dof = coarse_space->dof_of;
    const Rows& A = fine.lower;
    const int n = 3 * nodes.n_vertices;
    VectorXd z = A.triangularView<Eigen::Lower>().solve(r);
    VectorXd d = -(A.transpose() * z);  // r - A z = -L^T z
    for (int i = 0; i < z.size(); ++i) d(i) += A.valuePtr()[A.outerIndexPtr()[i + 1] - 1] * z(i);
    VectorXd c(n);
    for (int k = 0; k < n; ++k) c(coarse_dof[k]) = d(dof[k]);
    for (int e = 0; e < nodes.edges.cols(); ++e)
      for (int k = 0; k < 3; ++k) {
        const double half = d(dof[n + 3 * e + k]) / 2;
        c(coarse_dof[3 * nodes.edges(0, e) + k]) += half;
        c(coarse_dof[3 * nodes.edges(1, e) + k]) += half;
      }
    for (int k = 0; k < n; ++k)
      if (fine.is_held[dof[k]]) c(coarse_dof[k]) = 0;
    c = solve_degree_1(c);
    for (int k = 0; k < n; ++k)
      if (!fine.is_held[dof[k]]) z(dof[k]) += c(coarse_dof[k]);
    for (int e = 0; e < nodes.edges.cols(); ++e)
      for (int k = 0; k < 3; ++k)
        if (const unsigned i = dof[n + 3 * e + k]; !fine.is_held[i])
          z(i) += (c(coarse_dof[3 * nodes.edges(0, e) + k]) + c(coarse_dof[3 * nodes.edges(1, e) + k])) / 2;
    d = r;
    d.noalias() -= A.selfadjointView<Eigen::Lower>() * z;
    A.transpose().triangularView<Eigen::Upper>().solveInPlace(d);
    return z + d;
  }

  LinearReport iterate(const SystemMatrix& fine, const Eigen::MatrixXd& rigid, const VectorXd& b,
                       double tolerance, int max_iterations) const {
    return conjugate_gradients(
        [&](const VectorXd& p, VectorXd& Kp) {
          Kp.noalias() = fine.lower.selfadjointView<Eigen::Lower>() * p;
        },
        [&](const VectorXd& r) { return apply(fine, r); }, fine.lower.norm(), rigid, b, tolerance,
        max_iterations);
  }

  std::string name() const {
    const std::string degree_1 = multigrid ? "algebraic multigrid" : "Cholesky";
    if (direct || !coarse_space) return "CG, " + (direct ? "Cholesky" : degree_1);
    return "CG, two levels (Gauss-Seidel, " + degree_1 + " on degree 1)";
  }
};

TwoLevelSolver::TwoLevelSolver(const Nodes& nodes, const Space& fine_space, const Space* coarse_space)
    : levels_(new Levels{nodes, fine_space, coarse_space, {}, {}, {}}) {}
TwoLevelSolver::~TwoLevelSolver() = default;

void TwoLevelSolver::forget() {
  levels_->is_ready = false;
}

LinearReport TwoLevelSolver::solve(const SystemMatrix& fine, const SystemMatrix& degree_1,
                                   const Eigen::MatrixXd& rigid, const VectorXd& b, double tolerance) {
  Levels& s = *levels_;
  const VectorXd right = without(rigid, b);
  LinearReport report;
  const auto iterate = [&](int max_iterations) {
    const int before = report.iterations;
    report = s.iterate(fine, rigid, right, tolerance, max_iterations);
    report.solver = s.name();
    const int n = report.iterations;
    report.iterations += before;
    return n;
  };
  if (s.is_ready) {  // a factor of another matrix, as long as it serves
    const int n = iterate(2 * s.n_iterations + 10);
    if (report.is_converged) {
      s.is_ready = n <= s.n_iterations + s.n_iterations / 2 + 5;
      return report;
    }
  }
  const bool is_singular = rigid.cols() > 0;
  report.is_definite = s.factorise(fine, degree_1, is_singular);
  if (!report.is_definite) return report;
  const bool has_choice = s.coarse_space && !s.direct && fine.lower.rows() <= kLargestDirect;
  s.n_iterations = iterate(has_choice ? kPatience : kMaxIterations);
  if (report.is_converged || !has_choice) return report;
  s.direct.emplace();
  report.is_definite = s.factorise(fine, degree_1, is_singular);
  if (report.is_definite) s.n_iterations = iterate(kRefinements);
  return report;
}

}  // namespace testbed::fem
