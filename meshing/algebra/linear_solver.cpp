#include "meshing/algebra/linear_solver.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;

// Costs in iterations with block Jacobi, measured from 1000 nodes to 60,000. On fewer than kSmallest a factor
// of n nodes costs 0.4 n of them, a solve with it 0.01 n.
constexpr int kSmallest = 500;       // nodes from which on single precision and multigrid are faster
constexpr double kMultigrid = 300;   // to make one
constexpr double kCycle = 6;         // an iteration with it
constexpr double kCyclesADigit = 4;  // iterations with it, a good one
constexpr double kFactor = 0.4, kFactorSolve = 0.01;
constexpr int kWornOut = 12;       // iterations more than at first, at which a factor is made anew
constexpr int kStandsStill = 100;  // iterations with multigrid, after which a factor is tried,
constexpr double kSlowest = 12;    // or of each digit, if these are more
constexpr int kGoesOn = 4;         // times as many, foreseen by the digits gained, that are still worth it
constexpr int kMaxIterations = 5000, kMaxWithFactor = 1000;
constexpr int kMaxInSingle = 200;  // with a factor in single precision: more means slivers, beyond it
constexpr int kFewEnough = 30000;  // nodes, to try double precision where single is spent

double digits(double tolerance) {
  return std::max(1., -std::log10(tolerance));
}

/// Whether iterations that have not converged gained so many digits that going on is worth it.
bool promises_an_end(const SolveReport& report, double tolerance) {
  return !report.is_converged && kGoesOn * -std::log10(report.residual) >= digits(tolerance);
}

void set_inverse_diagonal(const LinearSystem& A, std::vector<Eigen::Matrix3d>& inverse) {
  A.diagonal(inverse);
  for (Eigen::Matrix3d& block : inverse) block = block.inverse().eval();
}

/// A preconditioner of an earlier system that knows single precision alone, on one at hand.
struct OfSystem {
  const std::function<void(const PaddedField& r, PaddedField& z)> apply;
  const LinearSystem& A;

  double operator()(const PaddedField& r, PaddedField& z) const {
    // Rounding of r along motions without stiffness would come back enlarged by what regularises the preconditioner.
    PaddedField filtered = r;
    A.single_filter(filtered);
    apply(filtered, z);
    A.single_filter(z);  // constraints may have come since
    return dot(filtered, z);
  }
  void operator()(const Matrix3Xd& r, Matrix3Xd& z) const {
    const double size = r.norm();
    PaddedField single_r, single_z;
    pad(r, size > 0 ? 1 / size : 1, single_r);
    (*this)(single_r, single_z);
    z = Matrix3Xd::Zero(3, r.cols());
    add_unpadded(single_z, size, z);
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
  constexpr double kNoBound = std::numeric_limits<double>::infinity();
  constexpr double kDeepest = 1e-5, kBelow = 0.9, kLost = 0.5, kRounding = 1e-5;
  SolveReport report;
  const double b_norm = b.norm();
  Matrix3Xd r, Ax;
  PaddedField single, correction;
  const auto measure = [&] {
    A.product(x, Ax);
    r = b - Ax;
    report.residual = b_norm > 0 ? r.norm() / b_norm : r.norm();
    report.is_converged = report.residual <= tolerance;
  };
  if (x.isZero(0)) {
    r = b;
    report.residual = b_norm > 0 ? 1 : 0;
    report.is_converged = report.residual <= tolerance;
  } else {
    measure();
  }
  while (!report.is_converged && report.iterations < max_iterations) {
    const double before = report.residual, size = r.norm();
    pad(r, 1 / size, single);
    correction.setZero(4, single.cols());
    const SolveReport inner = conjugate_gradients(
        A.single_product, precondition, single, 1, correction,
        std::max(kDeepest, kBelow * tolerance / before), max_iterations - report.iterations,
        is_hard_ ? std::max(kDeepest, tolerance / before) : kNoBound);
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
    is_spent =
        !is_hard_ && !single.is_converged && single.iterations >= max_iterations && b.cols() <= kFewEnough;
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

LinearSolver LinearSolver::of_stiffness(bool is_floppy) {
  LinearSolver solver;
  solver.is_hard_ = true;
  solver.is_floppy_ = is_floppy;
  solver.is_single_enough_ = !is_floppy;
  return solver;
}

LinearSolver LinearSolver::of_halved_edges(const Eigen::Matrix2Xi& between, SinglePreconditioner coarser) {
  LinearSolver solver = of_stiffness(false);
  solver.preconditioner_ = HalvedEdges{between, std::move(coarser), nullptr};
  solver.choice_ = "multigrid: above that of edges twice as long";
  return solver;
}

SinglePreconditioner LinearSolver::preconditioner() {
  if (auto* const groups = std::get_if<RigidGroups>(&preconditioner_); groups && groups->multigrid)
    return [&multigrid = *groups->multigrid](const PaddedField& r, PaddedField& z) { multigrid.apply(r, z); };
  auto* const factor = std::get_if<Factor>(&preconditioner_);
  if (!factor || !factor->cholesky) return {};
  if (factor->single.supernodes.empty()) factor->single = factor->cholesky->single_precision();
  return [&single = factor->single](const PaddedField& r, PaddedField& z) { single.solve(r, z); };
}

LinearSolver LinearSolver::of_factor(const std::string& why) {
  LinearSolver solver = of_stiffness(true);
  solver.preconditioner_ = Factor{};
  solver.choice_ = "Cholesky factor: " + why;
  return solver;
}

SolveReport LinearSolver::solve_with(BlockJacobi& jacobi, const LinearSystem& A, const Matrix3Xd& b,
                                     Matrix3Xd& x, double tolerance, int& n) {
  const bool is_small = b.cols() < kSmallest;
  if (is_hard_) {
    if (is_small || is_floppy_)
      preconditioner_ = Factor{};
    else
      preconditioner_ = RigidGroups{};
    choice_ = is_floppy_ ? "Cholesky factor: motions may cost no energy"
              : is_small ? "Cholesky factor: the nodes are few"
                         : "multigrid: a stiffness alone is hard";
    return solve_on(A, b, x, tolerance, n);
  }
  set_inverse_diagonal(A, jacobi.inverse);
  if (krylov_ != Krylov::Cg) {
    const bool is_stabilised = krylov_ == Krylov::BiCgStab;
    choice_ = std::string("bi-conjugate gradients") + (is_stabilised ? " stabilised" : "") +
              ", block Jacobi: asked for";
    const SolveReport report =
        is_stabilised ? stabilised_bi_conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations)
                      : bi_conjugate_gradients(A.product, A.product, jacobi, b, x, tolerance, kMaxIterations);
    n += report.iterations;
    return report;
  }
  jacobi.single = pad(jacobi.inverse);
  const SolveReport first = iterate(A, jacobi, b, x, tolerance, patience_, n);
  if (!is_small) waste_ += std::max(0., first.iterations - kCycle * kCyclesADigit * digits(tolerance));
  const bool is_hard = !first.is_converged && first.iterations >= patience_;
  if (!is_hard && waste_ < patience_) return first;
  waste_ = 0;
  const std::string why = ": block Jacobi took more than " + std::to_string(patience_) + " iterations";
  if (is_small) {
    choice_ = "Cholesky factor of an earlier matrix" + why;
    preconditioner_ = Factor{};
  } else {
    choice_ = "multigrid of an earlier matrix" + why + (is_hard ? "" : " too many in sum");
    preconditioner_ = RigidGroups{};
  }
  return is_hard ? solve_on(A, b, x, tolerance, n) : first;
}

SolveReport LinearSolver::solve_with(Factor& factor, const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x,
                                     double tolerance, int& n) {
  const bool is_new = !factor.cholesky;
  if (is_new) {
    factor.cholesky = std::make_unique<BlockCholesky>(A.matrix());
    if (!factor.cholesky->is_ok()) {
      BlockJacobi jacobi;
      set_inverse_diagonal(A, jacobi.inverse);
      const SolveReport rest = conjugate_gradients(A.product, jacobi, b, x, tolerance, kMaxIterations);
      n += rest.iterations;
      factor.cholesky.reset();
      return rest;
    }
    if (b.cols() >= kSmallest && !is_floppy_) factor.single = factor.cholesky->single_precision();
  }
  const auto exactly = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    factor.cholesky->solve(r, z);
    A.filter(z);  // constraints may have come since
  };
  SolveReport report;
  if (b.cols() < kSmallest || is_floppy_) {
    report = conjugate_gradients(A.product, exactly, b, x, tolerance, kMaxWithFactor);
    n += report.iterations;
  } else {
    const auto apply = [&](const PaddedField& r, PaddedField& z) { factor.single.solve(r, z); };
    report = iterate(A, OfSystem{apply, A}, b, x, tolerance, is_hard_ ? kMaxInSingle : kMaxIterations, n);
  }
  Service& service = factor.service;
  if (is_new) service = {report.iterations / digits(tolerance)};
  if (report.iterations > kWornOut + service.first_rate * digits(tolerance)) {
    const int cost = static_cast<int>((kFactor + kFactorSolve * report.iterations) * b.cols());
    factor.cholesky.reset();
    if (!is_hard_ && cost > patience_) {
      preconditioner_ = BlockJacobi{};
      choice_ = "block Jacobi: a Cholesky factor wears out too soon";
    }
    patience_ = std::max(patience_, cost);
  }
  return report;
}

/// Leaves the next system to a new multigrid or, as systems may have become easy, to block Jacobi, as long as
/// that costs no more.
void LinearSolver::wear_out(RigidGroups& groups) {
  if (is_hard_) {
    groups.multigrid.reset();
    return;
  }
  preconditioner_ = BlockJacobi{};
  patience_ = kMultigrid;
  choice_ = "block Jacobi: multigrid of an earlier matrix has worn out";
}

SolveReport LinearSolver::solve_with(RigidGroups& groups, const LinearSystem& A, const Matrix3Xd& b,
                                     Matrix3Xd& x, double tolerance, int& n) {
  const bool is_new = !groups.multigrid;
  if (is_new) groups.multigrid = std::make_unique<Multigrid>(A.matrix(), *A.positions, A.constrain);
  const OfSystem precondition{[&](const PaddedField& r, PaddedField& z) { groups.multigrid->apply(r, z); },
                              A};
  const double n_digits = digits(tolerance);
  const int patience = std::max(kStandsStill, static_cast<int>(kSlowest * n_digits));
  SolveReport report = iterate(A, precondition, b, x, tolerance, patience, n);
  if (is_new && promises_an_end(report, tolerance))
    report = iterate(A, precondition, b, x, tolerance, kGoesOn * patience, n);
  if (!report.is_converged && report.iterations >= patience) {
    if (!is_new) {
      wear_out(groups);
      return solve_on(A, b, x, tolerance, n);
    }
    if (n_factor_entries(A.matrix()) <= kMostFactorEntries) {
      choice_ = "Cholesky factor: multigrid took more than " + std::to_string(patience) + " iterations";
      preconditioner_ = Factor{};
      return solve_on(A, b, x, tolerance, n);
    }
    report = iterate(A, precondition, b, x, tolerance, kMaxIterations, n);
  }
  Service& service = groups.service;
  if (is_new) service = {report.iterations / n_digits};
  service.excess += std::max(0., report.iterations - service.first_rate * n_digits);
  if (kCycle * service.excess > kMultigrid) wear_out(groups);
  return report;
}

SolveReport LinearSolver::solve_with(HalvedEdges& halved, const LinearSystem& A, const Matrix3Xd& b,
                                     Matrix3Xd& x, double tolerance, int& n) {
  if (!halved.two_grid)
    halved.two_grid = std::make_unique<TwoGrid>(A.matrix(), *A.positions, halved.between, halved.coarser);
  const OfSystem precondition{[&](const PaddedField& r, PaddedField& z) { halved.two_grid->apply(r, z); }, A};
  SolveReport report = iterate(A, precondition, b, x, tolerance, kStandsStill, n);
  if (promises_an_end(report, tolerance))
    report = iterate(A, precondition, b, x, tolerance, (kGoesOn - 1) * kStandsStill, n);
  return report;
}

void archive(Archive& a, LinearSolver& solver) {
  using Factor = LinearSolver::Factor;
  using RigidGroups = LinearSolver::RigidGroups;
  a(solver.is_hard_, solver.is_floppy_, solver.waste_, solver.patience_, solver.is_single_enough_);
  bool is_factor = std::holds_alternative<Factor>(solver.preconditioner_),
       is_multigrid = std::holds_alternative<RigidGroups>(solver.preconditioner_);
  a(solver.choice_, is_factor, is_multigrid);
  if (is_factor) {
    Factor& factor =
        a.is_reading() ? solver.preconditioner_.emplace<Factor>() : std::get<Factor>(solver.preconditioner_);
    a(factor.cholesky, factor.single, factor.service.first_rate, factor.service.excess);
  }
  if (is_multigrid) {
    RigidGroups& groups = a.is_reading() ? solver.preconditioner_.emplace<RigidGroups>()
                                         : std::get<RigidGroups>(solver.preconditioner_);
    a(groups.multigrid, groups.service.first_rate, groups.service.excess);
  }
}

}  // namespace testbed::meshing
