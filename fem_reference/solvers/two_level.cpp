#include "fem_reference/solvers/two_level.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "fem_reference/base/memory.h"
#include "fem_reference/solvers/amg.h"
#include "meshing/algebra/rigid_motion.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using meshing::BlockMatrix;
using meshing::PaddedField;

constexpr int kFew = 10000;     // nodes of degree 1 that are always factorised
constexpr double kLean = 1000;  // entries of their factor for each, with which it is faster below degree 2
constexpr int kPatience = 120;  // iterations, four times those on good tetrahedra
constexpr int kMaxIterations = 2000;
constexpr int kTurns = 20;
constexpr double kNear = 1e-3;  // tolerance of the steps that end at an equilibrium
constexpr double kRounding = 1e-5;
/// Of the diagonal, where rigid motions are free; the larger ones where a body out of balance would turn or
/// buckle.
constexpr double kShifts[] = {1e-8, 1e-4, 1e-2, 1};

void scale_diagonal(BlockMatrix& A, double factor) {
  for (const int k : A.diagonal) A.block[k].diagonal() *= factor;
}

/// The positive semidefinite R with R^2 = S.
Eigen::Matrix3d root_of(const Eigen::Matrix3d& S) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(S);
  const Eigen::Vector3d roots = eigen.eigenvalues().cwiseMax(0).cwiseSqrt();
  return eigen.eigenvectors() * roots.asDiagonal() * eigen.eigenvectors().transpose();
}

/// Makes A no less stiff without blocks B than with them: x^T (B B^T)^(1/2) x + y^T (B^T B)^(1/2) y is at least twice
/// x^T B y.
void make_up_for(const std::vector<meshing::SymmetricBlock>& outside, BlockMatrix& A) {
  for (const meshing::SymmetricBlock& b : outside) {
    A.block[A.diagonal[b.i]] += root_of(b.block * b.block.transpose());
    A.block[A.diagonal[b.j]] += root_of(b.block.transpose() * b.block);
  }
}

/// Factorises the matrix that fill(A) makes, as it is or, where it is singular, a little stiffer.
bool factorise(BlockMatrix A, const TwoLevelSolver::Fill& fill, bool is_singular,
               std::optional<meshing::BlockCholesky>& factor) {
  A.block.assign(A.column.size(), Eigen::Matrix3d::Zero());
  const auto n_within = A.block.size();
  if (const auto outside = fill(A); !outside.empty()) A = with_blocks(A, outside);
  if (factor && (A.block.size() > n_within || factor->n_blocks() > n_within))
    factor.reset();  // its pattern changes
  double scale = 1;
  const auto try_once = [&](double wanted) {
    scale_diagonal(A, wanted / scale);
    scale = wanted;
    if (factor)
      factor->update(A);
    else
      factor.emplace(A);
    return factor->is_ok();
  };
  if (!is_singular && try_once(1)) return true;
  return std::any_of(std::begin(kShifts), std::end(kShifts),
                     [&](double shift) { return try_once(1 + shift); });
}

}  // namespace

/// The operators of a solve.
struct TwoLevelSolver::Pass {
  const TwoLevelSolver& solver;
  const Stiffness& A;
  std::vector<Summed<PaddedField>> rigid;
  std::optional<meshing::GaussSeidel> sweeps;
  const meshing::StrongCouplings* strong = nullptr;  // of one process
  PaddedField added;  // to the diagonal in sweeps of several processes, without which these may diverge

  Pass(const TwoLevelSolver& solver, const Stiffness& A, const Eigen::MatrixXd& motions)
      : solver(solver), A(A), rigid(motions.cols()) {
    for (Eigen::Index k = 0; k < motions.cols(); ++k)
      solver.pad(motions.col(k).reshaped(3, solver.X_.cols()), 1, rigid[k]);
    for (PaddedField& motion : rigid) solver.clear_ghosts(motion);
    if (!solver.corners_ || solver.is_whole_) return;
    const BlockMatrix& pattern = solver.fine_.pattern();
    if (solver.share_.is_whole) {
      if (!A.strong) A.strong.emplace(pattern, A.blocks, solver.by_rank_);
      strong = &*A.strong;
    }
    const int n_own = solver.fine_.first_row().back();
    if (!solver.share_.is_whole) added.setZero(4, meshing::padded(pattern.rows()));
    for (int i = 0; i < n_own; ++i)
      for (int k = pattern.row_start[i + 1] - 1; pattern.column[k] >= n_own; --k)
        added.col(i).head<3>() +=
            0.5f *
            Eigen::Matrix3f::Map(&A.blocks[9 * static_cast<std::size_t>(k)]).cwiseAbs().rowwise().sum();
    sweeps.emplace(pattern, A.blocks, solver.fine_.first_row(), added);
  }

  void remove_rigid(Summed<PaddedField>& u) const {
    for (const auto& motion : rigid) meshing::add_scaled(-static_cast<float>(dot(motion, u)), motion, u);
  }
  void multiply(const PaddedField& p, Summed<PaddedField>& y) const {
    solver.multiply(A, p, y);
    remove_rigid(y);
  }
  /// One level: a factor or a cycle. Two: z = (D + L)^-1 r; z += P A_1^-1 P^T (r - A z);
  /// z += (D + L^T)^-1 (r - A z), which is symmetric and positive definite. Of several processes each has an L
  /// of its own, and half the sums of what it leaves out are added to D [Baker, Falgout, Kolev & Yang 2011].
  void precondition(const PaddedField& of, Summed<PaddedField>& z) const {
    Summed<PaddedField> r;
    r = of;
    remove_rigid(r);  // rounding, which would come back enlarged by what regularises degree 1
    if (strong) {
      const auto two_levels = [&](const PaddedField& b, PaddedField& x) {
        PaddedField d;
        sweeps->sweep_down(b, x);
        sweeps->residual_of_sweep(x, d);
        solver.correct_corners(d, x);
        sweeps->sweep_up(b, x);
      };
      strong->around(two_levels, r, z);
    } else if (sweeps) {
      PaddedField d;
      sweeps->sweep_down(r, z);
      solver.exchange_.update(z);
      sweeps->residual_of_sweep(z, d);
      d += added.cwiseProduct(z);
      solver.exchange_.update(d);
      solver.correct_corners(d, z);
      sweeps->sweep_up(r + added.cwiseProduct(z), z);
      solver.clear_ghosts(z);
    } else {
      solver.solve_degree_1(r, z);
    }
    remove_rigid(z);
  }
};

TwoLevelSolver::TwoLevelSolver(const Share& share, const Matrix3Xd& X, const Eigen::Matrix2Xi& edges,
                               const TetBatches& fine, const TetBatches* corners)
    : share_(share), X_(X), fine_(fine), corners_(corners), exchange_(share.exchange.over(fine.rank())) {
  if (!corners) return;
  by_rank_.resizeLike(X);
  for (Eigen::Index i = 0; i < X.cols(); ++i) by_rank_.col(fine_.rank()[i]) = X.col(i);
  exchange_corners_ = share.exchange.over(corners->rank());
  const Eigen::Index n_corners = X.cols() - edges.cols();
  ends_.resize(2, X.cols());
  for (Eigen::Index i = 0; i < X.cols(); ++i)
    for (int end = 0; end < 2; ++end)
      ends_(end, fine.rank()[i]) =
          corners->rank()[i < n_corners ? static_cast<int>(i) : edges(end, i - n_corners)];
}

void TwoLevelSolver::hold(const std::vector<char>& is_constrained) {
  const auto mask = [&](const TetBatches& tets, PaddedField& free) {
    const auto n = static_cast<Eigen::Index>(tets.rank().size());
    free.setZero(4, meshing::padded(n));
    for (Eigen::Index i = 0; i < n; ++i)
      for (int c = 0; c < 3; ++c) free(c, tets.rank()[i]) = is_constrained[3 * i + c] ? 0.f : 1.f;
  };
  mask(fine_, free_);
  if (corners_) mask(*corners_, free_corners_);
  multigrid_ = {};
  is_ready_ = is_whole_ = false;
}

void TwoLevelSolver::pad(const Matrix3Xd& u, double factor, PaddedField& result) const {
  result.setZero(4, meshing::padded(u.cols()));
  for (Eigen::Index i = 0; i < u.cols(); ++i)
    result.col(fine_.rank()[i]).head<3>() = (factor * u.col(i)).cast<float>();
}

void TwoLevelSolver::add_unpadded(const PaddedField& w, double factor, Matrix3Xd& u) const {
  for (Eigen::Index i = 0; i < u.cols(); ++i)
    u.col(i) += factor * w.col(fine_.rank()[i]).head<3>().cast<double>();
}

void TwoLevelSolver::correct_corners(const PaddedField& d, PaddedField& z) const {
  PaddedField force = PaddedField::Zero(4, free_corners_.cols()), move;
  for (Eigen::Index i = 0; i < ends_.cols(); ++i) {
    const Eigen::Vector4f half = 0.5f * d.col(i);
    force.col(ends_(0, i)) += half;
    force.col(ends_(1, i)) += half;
  }
  force = force.cwiseProduct(free_corners_);
  solve_degree_1(force, move);
  exchange_corners_.update(move);
  for (Eigen::Index i = 0; i < ends_.cols(); ++i)
    z.col(i) += free_.col(i).cwiseProduct(0.5f * (move.col(ends_(0, i)) + move.col(ends_(1, i))));
}

void TwoLevelSolver::solve_degree_1(const PaddedField& r, PaddedField& z) const {
  if (multigrid_)
    multigrid_(r, z);
  else
    factor_->solve(r, z);
}

bool TwoLevelSolver::factorise_whole(const Stiffness& A, bool is_singular) {
  cholesky_.reset();
  factor_.reset();
  multigrid_ = {};
  is_whole_ = true;
  return factorise(A, is_singular);
}

bool TwoLevelSolver::may_factorise() const {
  return share_.is_whole && !is_whole_ && (corners_ || multigrid_) &&
         memory_needed(fine_.n_tetrahedra(), corners_ ? 2 : 1, Memory::FactorAndCopy) < memory_available();
}

void TwoLevelSolver::turn_to_factor(const Stiffness& A, bool is_singular) {
  if (!may_factorise() || factorise_whole(A, is_singular)) return;
  is_whole_ = false;
  factorise(A, is_singular);
}

bool TwoLevelSolver::factorise(const Stiffness& A, bool is_singular) {
  const bool is_of_corners = corners_ && !is_whole_;
  const TetBatches& tets = is_of_corners ? *corners_ : fine_;
  const auto& fill = is_of_corners ? A.fill_corners : A.fill_fine;
  const auto n = static_cast<int>(tets.rank().size());
  const auto is_lean = [&] {
    return n_factor_entries(tets.pattern()) <= std::min(kLean * n, meshing::kMostFactorEntries);
  };
  if (is_whole_ || (share_.is_whole && (n <= kFew || (corners_ && is_lean())))) {
    if (!fem::factorise(tets.pattern(), fill, is_singular, cholesky_)) return false;
    factor_ = cholesky_->single_precision();
    return true;
  }
  BlockMatrix matrix = tets.pattern();
  matrix.block.assign(matrix.column.size(), Eigen::Matrix3d::Zero());
  make_up_for(fill(matrix), matrix);
  if (is_singular) scale_diagonal(matrix, 1 + kShifts[0]);
  multigrid_ = {};
  multigrid_ = multigrid_of(matrix, tets);
  return true;
}

/// Of one process, or Trilinos' of several.
meshing::SinglePreconditioner TwoLevelSolver::multigrid_of(const BlockMatrix& A,
                                                           const TetBatches& tets) const {
  const auto n = static_cast<Eigen::Index>(tets.rank().size()), n_own = Eigen::Index(tets.first_row().back());
  if (share_.is_whole) {
    Matrix3Xd positions(3, n);
    for (Eigen::Index i = 0; i < n; ++i) positions.col(tets.rank()[i]) = X_.col(i);
    const auto free = (corners_ ? free_corners_ : free_).topLeftCorner(3, n).cast<double>();
    return [cycle = std::make_shared<meshing::Multigrid>(A, positions, [&](Matrix3Xd& u) {
              u = u.cwiseProduct(free);
            })](const PaddedField& r, PaddedField& z) { cycle->apply(r, z); };
  }
  const Eigen::MatrixXd by_node = share_.rigid_motions(X_.leftCols(n));
  Eigen::MatrixXd motions(3 * n_own, 6);
  std::vector<int> number(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int row = tets.rank()[i];
    if (row < n_own) motions.middleRows<3>(3 * row) = by_node.middleRows<3>(3 * i);
    number[row] = share_.number[i];
  }
  return [n_own, cycle = std::make_shared<AlgebraicMultigrid>(A, std::move(motions), number)](
             const PaddedField& r, PaddedField& z) {
    z.setZero(4, r.cols());
    z.topLeftCorner(3, n_own) =
        cycle->apply(r.topLeftCorner(3, n_own).cast<double>().reshaped()).reshaped(3, n_own).cast<float>();
  };
}

std::string TwoLevelSolver::name() const {
  const std::string degree_1 = multigrid_ ? "algebraic multigrid" : "Cholesky";
  if (is_whole_) return "CG, Cholesky of all, as iterations stood still";
  const std::string one =
      corners_ ? "CG, two levels (Gauss-Seidel, " + degree_1 + " on degree 1)" : "CG, " + degree_1;
  return share_.is_whole ? one : one + ", " + std::to_string(processes().n) + " processes";
}

LinearReport TwoLevelSolver::solve(const Stiffness& A, const Eigen::MatrixXd& rigid, const Matrix3Xd& r,
                                   double tolerance, Matrix3Xd& x, bool may_turn) {
  LinearReport report;
  const double size = share_.norm(r);
  if (size == 0) {
    report.is_converged = true;
    return report;
  }
  const bool is_singular = rigid.cols() > 0;
  Summed<PaddedField> rest, solution;
  pad(r, 1 / size, rest);
  clear_ghosts(rest);
  solution.setZero(4, rest.cols());
  bool is_indefinite = false;  // a factor would change nothing
  const auto iterate = [&](int max_iterations) {
    const Pass pass(*this, A, rigid);
    pass.remove_rigid(rest);
    const int before = report.iterations;
    int n = 0;
    Summed<PaddedField> p, Ap;  // the last direction
    for (int turn = 0; turn < kTurns; ++turn) {
      static_cast<meshing::SolveReport&>(report) = conjugate_gradients(
          [&](const PaddedField& q, Summed<PaddedField>& y) {
            pass.multiply(q, y);
            p = q;
            Ap = y;
          },
          [&](const PaddedField& q, Summed<PaddedField>& z) { pass.precondition(q, z); }, rest, 1, solution,
          tolerance, max_iterations - n);
      n += report.iterations;
      is_indefinite = report.curvature < 0;
      if (!is_indefinite || tolerance > kNear) break;
      // An equilibrium that would buckle is one as well: near it, along the soft motion too.
      advance(static_cast<float>(dot(rest, p) / dot(p, Ap)), p, Ap, solution, rest);
    }
    report.is_definite = report.curvature >= -kRounding || tolerance <= kNear;
    if (!report.is_definite && dot(solution, solution) == 0) pass.precondition(rest, solution);  // downhill
    report.iterations = before + n;
    return n;
  };
  const auto end = [&] {
    report.solver = name();
    add_unpadded(solution, size, x);
    return report;
  };
  if (is_ready_) {  // a factor of another matrix, as long as it serves
    const int n = iterate(2 * n_iterations_ + 10);
    is_ready_ = n <= n_iterations_ + n_iterations_ / 2 + 5;
    if (report.is_converged || is_indefinite) return end();
  }
  const auto find_factor = [&](bool is_whole) {
    is_ready_ = is_whole ? factorise_whole(A, is_singular) : factorise(A, is_singular);
    return is_ready_;
  };
  if (!find_factor(false)) {
    report.is_definite = false;
    return end();
  }
  const bool is_first_try = may_factorise();
  n_iterations_ = iterate(is_first_try ? kPatience : kMaxIterations);
  if (report.is_converged || is_indefinite || !is_first_try || !may_turn) return end();
  if (!find_factor(true)) {
    report.is_definite = false;
    return end();
  }
  n_iterations_ = iterate(kMaxIterations);
  return end();
}

void TwoLevelSolver::add_product(const Stiffness& A, double factor, const Matrix3Xd& x, Matrix3Xd& y) const {
  PaddedField p, Ap;
  pad(x, 1, p);
  multiply(A, p, Ap);
  add_unpadded(Ap, factor, y);
}

void TwoLevelSolver::multiply(const Stiffness& A, const PaddedField& p, PaddedField& y) const {
  y.setZero(4, p.cols());
  PaddedField with_ghosts;
  if (!share_.is_whole) {
    with_ghosts = p;
    exchange_.update(with_ghosts);
  }
  const PaddedField& q = share_.is_whole ? p : with_ghosts;
  meshing::add_product(fine_.pattern(), A.blocks, q, y);
  meshing::add_product(A.outside.blocks, q, y);
  for (const PaddedField& g : A.outside.roots)
    meshing::add_scaled(static_cast<float>(sum_over_processes(meshing::dot(g, p))), g, y);
  clear_ghosts(y);
}

void TwoLevelSolver::clear_ghosts(PaddedField& u) const {
  u.rightCols(u.cols() - fine_.first_row().back()).setZero();
}

std::function<void(const Matrix3Xd& r, Matrix3Xd& z)> TwoLevelSolver::preconditioner(
    const Stiffness& A, const Eigen::MatrixXd& rigid) const {
  if (!multigrid_ && (is_whole_ || !corners_))
    return [this, &rigid,
            by_rank = Eigen::PermutationMatrix<Eigen::Dynamic>(Eigen::Map<const Eigen::VectorXi>(
                fine_.rank().data(), static_cast<Eigen::Index>(fine_.rank().size())))](const Matrix3Xd& r,
                                                                                       Matrix3Xd& z) {
      cholesky_->solve(r * by_rank.transpose(), z);
      z = z * by_rank;
      z.reshaped() -= rigid * (rigid.transpose() * z.reshaped()).eval();
    };
  return [this, pass = std::make_shared<const Pass>(*this, A, rigid)](const Matrix3Xd& r, Matrix3Xd& z) {
    Summed<PaddedField> rest, solution;
    const double size = share_.norm(r);
    pad(r, size > 0 ? 1 / size : 1, rest);
    pass->precondition(rest, solution);
    z = Matrix3Xd::Zero(3, r.cols());
    add_unpadded(solution, size, z);
  };
}

}  // namespace testbed::fem
