#include "meshing/algebra/multigrid.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/random.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

template <int m, int n>
using Blocks = std::vector<Eigen::Matrix<double, m, n>>;

/// Compressed rows of blocks in double precision, of which a level is made.
template <int D>
struct Equations {
  const std::vector<int>&row_start, &column, &diagonal;
  const Blocks<D, D>& block;

  int n_rows() const { return static_cast<int>(row_start.size()) - 1; }
};

/// The same that owns its rows.
struct BodyEquations {
  std::vector<int> row_start{0}, column, diagonal;
  Blocks<6, 6> block;

  Equations<6> view() const { return {row_start, column, diagonal, block}; }
};

/// How rows follow the bodies of groups; blocks are transposed.
template <int D>
struct Prolongation {
  std::vector<int> row_start{0}, column;
  Blocks<6, D> block;
  Matrix3Xd centre;  ///< of each body (m)
};

/// Inverse on the directions in which A, scaled to a unit diagonal, is more than that: a group of one node or of
/// nodes on a line has rotations without effect.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& A, double zero) {
  const Eigen::ArrayXd d = A.diagonal();
  const Eigen::VectorXd scale = (d > 0).select(d.abs().rsqrt(), 0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * A * scale.asDiagonal());
  const Eigen::ArrayXd lambda = eigen.eigenvalues();
  const Eigen::VectorXd inverse = (lambda > zero).select(lambda.inverse(), 0);
  const Eigen::MatrixXd V = scale.asDiagonal() * eigen.eigenvectors();
  return V * inverse.asDiagonal() * V.transpose();
}

Blocks<3, 3> inverse_diagonal(const Equations<3>& A) {
  Blocks<3, 3> inverse(A.n_rows());
  for (int i = 0; i < A.n_rows(); ++i) inverse[i] = A.block[A.diagonal[i]].inverse();
  return inverse;
}

Blocks<6, 6> inverse_diagonal(const Equations<6>& A) {
  constexpr double kZero = 1e-6;  // below, what blocks lose in single precision is as large
  Blocks<6, 6> inverse(A.n_rows());
  for (int i = 0; i < A.n_rows(); ++i) inverse[i] = pseudo_inverse(A.block[A.diagonal[i]], kZero);
  return inverse;
}

template <class Block>
std::vector<float> single_precision(const std::vector<Block>& blocks) {
  constexpr int kEntries = Block::SizeAtCompileTime;
  std::vector<float> result(kEntries * blocks.size() + 2);
  for (size_t k = 0; k < blocks.size(); ++k)
    Eigen::Matrix<float, Block::RowsAtCompileTime, Block::ColsAtCompileTime>::Map(&result[kEntries * k]) =
        blocks[k].template cast<float>();
  return result;
}

template <int D>
BlockRows<D> single_precision(const Equations<D>& A, const Blocks<D, D>& inverse) {
  return {A.row_start, A.column, A.diagonal, single_precision(A.block), single_precision(inverse)};
}

/// The largest eigenvalue of A with its diagonal blocks scaled to ones, by power iteration.
template <int D>
double largest_eigenvalue(const BlockRows<D>& A) {
  constexpr int kIterations = 8;  // enough for the two digits that damping needs
  Random random(1);
  FieldOf<D> q = FieldOf<D>::Zero(D == 3 ? 4 : 8, D == 3 ? padded(A.n_rows()) : A.n_rows()), Aq;
  for (Eigen::Index i = 0; i < A.n_rows(); ++i)
    for (int c = 0; c < D; ++c) q(c, i) = static_cast<float>(random.uniform() - 0.5);
  multiply_inverse(A, FieldOf<D>(q), q);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    q /= static_cast<float>(std::sqrt(q.template cast<double>().squaredNorm()));
    multiply(A, q, Aq);
    multiply_inverse(A, Aq, q);
  }
  return std::sqrt(q.template cast<double>().squaredNorm());
}

/// Group of each row: a row with all its neighbours where none is in a group yet; what is left joins the
/// neighbour that it is tied to most. Rows that are constrained are in none. Ties count that are no weaker than a part
/// of the strongest of either row: groups of all that touch would be too large to move as one.
template <int D>
std::vector<int> group(const Equations<D>& A, const std::vector<bool>& is_constrained, int& n_groups) {
  constexpr double kWeak = 0.1;
  std::vector<double> size(A.n_rows()), strongest(A.n_rows(), 0), tie(A.column.size(), -1);
  for (int i = 0; i < A.n_rows(); ++i) size[i] = A.block[A.diagonal[i]].norm();
  for (int i = 0; i < A.n_rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k) {
      const int j = A.column[k];
      if (is_constrained[i] || is_constrained[j]) continue;
      tie[k] = A.block[k].norm() / std::sqrt(size[i] * size[j]);
      if (i != j) strongest[i] = std::max(strongest[i], tie[k]);
    }
  for (int i = 0; i < A.n_rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      if (tie[k] < kWeak * std::min(strongest[i], strongest[A.column[k]])) tie[k] = -1;
  std::vector<int> group(A.n_rows(), -1);
  n_groups = 0;
  for (int i = 0; i < A.n_rows(); ++i) {
    if (is_constrained[i]) continue;
    bool is_free = true;
    for (int k = A.row_start[i]; k < A.row_start[i + 1] && is_free; ++k)
      is_free = tie[k] < 0 || group[A.column[k]] < 0;
    if (!is_free) continue;
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      if (tie[k] >= 0) group[A.column[k]] = n_groups;
    ++n_groups;
  }
  std::vector<int> joined = group;
  for (int i = 0; i < A.n_rows(); ++i) {
    if (is_constrained[i] || group[i] >= 0) continue;
    double strongest = -1;
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      if (tie[k] > strongest && group[A.column[k]] >= 0) {
        strongest = tie[k];
        joined[i] = group[A.column[k]];
      }
  }
  return joined;
}

/// Motion of a row at an offset d from its body's centre: of D = 3 the translation, of 6 the rotation, too.
template <int D>
Eigen::Matrix<double, D, 6> follow(const Vector3d& d) {
  Eigen::Matrix<double, 6, 6> P = Eigen::Matrix<double, 6, 6>::Identity();
  P.topRows<3>() = rigid_motions_at(d);
  return P.topRows<D>();
}

/// P = (1 - omega D^-1 A) T; T moves each row as its group's rigid body.
/// @param free  of each row the projection onto what is not constrained; empty: all of it
template <int D>
Prolongation<D> prolongation(const Equations<D>& A, const Blocks<D, D>& inverse, double omega,
                             const Matrix3Xd& X, const std::vector<Eigen::Matrix3d>& free) {
  const int n = A.n_rows();
  std::vector<bool> is_constrained(n, false);
  for (size_t i = 0; i < free.size(); ++i) is_constrained[i] = free[i].isZero(0);
  int n_groups;
  const std::vector<int> groups = group(A, is_constrained, n_groups);
  Prolongation<D> P;
  P.centre = Matrix3Xd::Zero(3, n_groups);
  Eigen::VectorXd size = Eigen::VectorXd::Zero(n_groups);
  for (int i = 0; i < n; ++i)
    if (groups[i] >= 0) {
      P.centre.col(groups[i]) += X.col(i);
      ++size(groups[i]);
    }
  P.centre *= size.cwiseInverse().asDiagonal();
  Blocks<6, D> T(n, Eigen::Matrix<double, 6, D>::Zero());
  for (int i = 0; i < n; ++i) {
    if (groups[i] < 0) continue;
    T[i] = follow<D>(X.col(i) - P.centre.col(groups[i])).transpose();
    if constexpr (D == 3)
      if (!free.empty()) T[i] *= free[i];
  }
  std::vector<int> at(n_groups, -1);  // position of a group in the row at hand
  for (int i = 0; i < n; ++i) {
    const int first = P.row_start.back();
    const auto add_to = [&](int g) -> Eigen::Matrix<double, 6, D>& {
      if (at[g] < first) {
        at[g] = static_cast<int>(P.column.size());
        P.column.push_back(g);
        P.block.push_back(Eigen::Matrix<double, 6, D>::Zero());
      }
      return P.block[at[g]];
    };
    for (int k = A.row_start[i]; k < A.row_start[i + 1] && groups[i] >= 0; ++k)
      if (const int j = A.column[k]; groups[j] >= 0)
        add_to(groups[j]).noalias() += T[j] * A.block[k].transpose();
    for (int k = first; k < static_cast<int>(P.column.size()); ++k)
      P.block[k] = (-omega * P.block[k] * inverse[i].transpose()).eval();
    if (groups[i] >= 0) add_to(groups[i]) += T[i];
    P.row_start.push_back(static_cast<int>(P.column.size()));
  }
  return P;
}

/// P^T A P.
template <int D>
BodyEquations galerkin(const Equations<D>& A, const Prolongation<D>& P) {
  const int n = A.n_rows(), n_bodies = static_cast<int>(P.centre.cols());
  std::vector<int> start(n_bodies + 1, 0), row(P.column.size());  // rows that follow each body
  for (const int g : P.column) ++start[g + 1];
  for (int g = 0; g < n_bodies; ++g) start[g + 1] += start[g];
  std::vector<int> next(start.begin(), start.end() - 1);
  for (int i = 0; i < n; ++i)
    for (int k = P.row_start[i]; k < P.row_start[i + 1]; ++k) row[next[P.column[k]]++] = i;

  BodyEquations coarse;
  std::vector<int> seen(n_bodies, -1), is_near(n, -1);
  for (int g = 0; g < n_bodies; ++g) {
    const size_t first = coarse.column.size();
    for (int m = start[g]; m < start[g + 1]; ++m)
      for (int k = A.row_start[row[m]]; k < A.row_start[row[m] + 1]; ++k) {
        const int j = A.column[k];
        if (is_near[j] == g) continue;
        is_near[j] = g;
        for (int p = P.row_start[j]; p < P.row_start[j + 1]; ++p)
          if (seen[P.column[p]] != g) {
            seen[P.column[p]] = g;
            coarse.column.push_back(P.column[p]);
          }
      }
    std::sort(coarse.column.begin() + static_cast<std::ptrdiff_t>(first), coarse.column.end());
    coarse.row_start.push_back(static_cast<int>(coarse.column.size()));
  }
  const auto find = [&](int g, int h) {
    const auto begin = coarse.column.begin() + coarse.row_start[g],
               end = coarse.column.begin() + coarse.row_start[g + 1];
    return static_cast<int>(std::lower_bound(begin, end, h) - coarse.column.begin());
  };
  for (int g = 0; g < n_bodies; ++g) coarse.diagonal.push_back(find(g, g));
  coarse.block.assign(coarse.column.size(), Eigen::Matrix<double, 6, 6>::Zero());

  std::vector<int> at(n_bodies, -1), bodies;
  Blocks<6, D> W;  // of each body the row's part of (A P)^T
  for (int i = 0; i < n; ++i) {
    if (P.row_start[i] == P.row_start[i + 1]) continue;
    bodies.clear();
    W.clear();
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k) {
      const int j = A.column[k];
      for (int p = P.row_start[j]; p < P.row_start[j + 1]; ++p) {
        int& position = at[P.column[p]];
        if (position < 0) {
          position = static_cast<int>(bodies.size());
          bodies.push_back(P.column[p]);
          W.push_back(Eigen::Matrix<double, 6, D>::Zero());
        }
        W[position].noalias() += P.block[p] * A.block[k].transpose();
      }
    }
    for (const int h : bodies) at[h] = -1;
    for (int p = P.row_start[i]; p < P.row_start[i + 1]; ++p)
      for (size_t m = 0; m < bodies.size(); ++m)
        if (const int g = P.column[p]; bodies[m] >= g)
          coarse.block[find(g, bodies[m])].noalias() += P.block[p] * W[m].transpose();
  }
  next.assign(coarse.row_start.begin(), coarse.row_start.end() - 1);  // in each row; they fill in order
  for (int g = 0; g < n_bodies; ++g)
    for (int k = coarse.diagonal[g] + 1; k < coarse.row_start[g + 1]; ++k)
      coarse.block[next[coarse.column[k]]++] = coarse.block[k].transpose();
  return coarse;
}

constexpr double kDamping = 4. / 3;  // over the largest eigenvalue [Vanek, Mandel & Brezina 1996]

/// Equations of a level and their prolongation in single precision, the latter returned in double precision, too.
template <class Level, int D>
Prolongation<D> fill(const Equations<D>& A, const Matrix3Xd& X, const std::vector<Eigen::Matrix3d>& free,
                     Level& level) {
  const Blocks<D, D> inverse = inverse_diagonal(A);
  level.A = single_precision(A, inverse);
  Prolongation<D> P = prolongation(A, inverse, kDamping / largest_eigenvalue(level.A), X, free);
  level.P = {P.row_start, P.column, single_precision(P.block)};
  return P;
}

}  // namespace

Multigrid::Multigrid(const BlockMatrix& A, const Matrix3Xd& X,
                     const std::function<void(Matrix3Xd&)>& constrain)
    : strong_(A, meshing::single_precision(A), X) {
  constexpr Eigen::Index kCoarsest = 20;  // bodies whose matrix is inverted
  std::vector<Eigen::Matrix3d> free(A.rows());
  for (int c = 0; c < 3; ++c) {
    Matrix3Xd direction = Matrix3Xd::Zero(3, A.rows());
    direction.row(c).setOnes();
    constrain(direction);
    for (int i = 0; i < A.rows(); ++i) free[i].col(c) = direction.col(i);
  }
  BodyEquations coarse;
  Matrix3Xd centre;
  {
    const Equations<3> nodes{A.row_start, A.column, A.diagonal, A.block};
    const Prolongation<3> P = fill(nodes, X, free, nodes_);
    coarse = galerkin(nodes, P);
    centre = P.centre;
  }
  while (true) {
    Bodies& level = bodies_.emplace_back();
    const Eigen::Index n = centre.cols();
    level.b.setZero(8, n);
    level.x.setZero(8, n);
    if (n <= kCoarsest) break;
    const Prolongation<6> P = fill(coarse.view(), centre, {}, level);
    if (P.centre.cols() == n) break;
    coarse = galerkin(coarse.view(), P);
    centre = P.centre;
  }
  const Eigen::Index n = centre.cols();
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(6 * n, 6 * n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (int k = coarse.row_start[i]; k < coarse.row_start[i + 1]; ++k)
      dense.block<6, 6>(6 * i, 6 * coarse.column[k]) = coarse.block[k];
  constexpr double kRounding = 1e-10;
  coarsest_inverse_ = pseudo_inverse(dense, kRounding).cast<float>();
}

/// x of level l from its b.
void Multigrid::cycle(size_t l) {
  Bodies& level = bodies_[l];
  if (l + 1 == bodies_.size()) {
    const Eigen::VectorXf b = level.b.topRows<6>().reshaped();
    level.x.topRows<6>().reshaped() = coarsest_inverse_ * b;
    return;
  }
  Bodies& coarse = bodies_[l + 1];
  sweep_down(level.A, level.b, level.x);
  rest_of_sweep(level.A, level.x, level.rest);
  gather(level.P, level.rest, coarse.b);
  cycle(l + 1);
  add_motion(level.P, coarse.x, level.x);
  sweep_up(level.A, level.b, level.x);
}

double Multigrid::apply(const PaddedField& r, PaddedField& z) {
  const auto v_cycle = [this](const PaddedField& b, PaddedField& x) {
    sweep_down(nodes_.A, b, x);
    rest_of_sweep(nodes_.A, x, nodes_.rest);
    gather(nodes_.P, nodes_.rest, bodies_.front().b);
    cycle(0);
    add_motion(nodes_.P, bodies_.front().x, x);
    sweep_up(nodes_.A, b, x);
  };
  strong_.around(v_cycle, r, z);
  return dot(r, z);
}

TwoGrid::TwoGrid(const BlockMatrix& A, const Matrix3Xd& X, const Eigen::Matrix2Xi& between,
                 SinglePreconditioner coarser)
    : strong_(A, meshing::single_precision(A), X),
      between_(between),
      coarser_(std::move(coarser)),
      coarse_rest_(4, padded(between.maxCoeff() + 1)) {
  const Equations<3> nodes{A.row_start, A.column, A.diagonal, A.block};
  A_ = single_precision(nodes, inverse_diagonal(nodes));
}

double TwoGrid::apply(const PaddedField& r, PaddedField& z) {
  const auto two_grids = [this](const PaddedField& b, PaddedField& x) {
    sweep_down(A_, b, x);
    rest_of_sweep(A_, x, rest_);
    coarse_rest_.setZero();
    for (Eigen::Index i = 0; i < between_.cols(); ++i)
      for (const int node : between_.col(i)) coarse_rest_.col(node) += 0.5F * rest_.col(i);
    coarser_(coarse_rest_, coarse_);
    for (Eigen::Index i = 0; i < between_.cols(); ++i)
      for (const int node : between_.col(i)) x.col(i) += 0.5F * coarse_.col(node);
    sweep_up(A_, b, x);
  };
  strong_.around(two_grids, r, z);
  return dot(r, z);
}

}  // namespace testbed::meshing
