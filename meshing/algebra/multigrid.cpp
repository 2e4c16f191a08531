#include "meshing/algebra/multigrid.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/random.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr int kCoarsest = 20;  // bodies whose matrix is inverted

/// Inverse on the directions in which A, scaled to a unit diagonal, is not zero: a group of one node or of
/// nodes on a line has rotations without effect.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& A) {
  constexpr double kZero = 1e-12;
  const Eigen::ArrayXd d = A.diagonal();
  const Eigen::VectorXd scale = (d > 0).select(d.abs().rsqrt(), 0);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * A * scale.asDiagonal());
  const Eigen::ArrayXd lambda = eigen.eigenvalues();
  const Eigen::VectorXd inverse = (lambda > kZero).select(lambda.inverse(), 0);
  const Eigen::MatrixXd V = scale.asDiagonal() * eigen.eigenvectors();
  return V * inverse.asDiagonal() * V.transpose();
}

/// Motion of a member at an offset d from its group's centre: of D = 3 the translation, of 6 the rotation,
/// too.
template <int D>
Eigen::Matrix<double, D, 6> prolongation(const Vector3d& d) {
  Eigen::Matrix<double, 6, 6> P = Eigen::Matrix<double, 6, 6>::Identity();
  P.topRows<3>() = rigid_motions_at(d);
  return P.topRows<D>();
}

/// The largest eigenvalue of A with its diagonal blocks scaled to ones, by power iteration.
double largest_eigenvalue(const LinearSystem& A, const std::vector<Eigen::Matrix3d>& inverse) {
  constexpr int kIterations = 8;  // enough for the two digits that damping needs
  meshing::Random random(1);
  Matrix3Xd q(3, inverse.size()), Aq;
  for (double& c : q.reshaped()) c = random.uniform() - 0.5;
  A.filter(q);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    q.normalize();
    A.sparse_product(q, Aq);
    for (Eigen::Index i = 0; i < q.cols(); ++i) q.col(i).noalias() = inverse[i] * Aq.col(i);
  }
  return q.norm();
}

/// Adds a force f at an offset d from the centre of a group to the force and torque on it.
void add_wrench(const Vector3f& f, const Vector3f& d, BodyField& wrench, int group) {
  wrench.col(group).head<3>() += f;
  wrench.col(group).segment<3>(3) += d.cross(f);
}

/// How a point at an offset d from the centre of a group moves with it.
Vector3f translation(const BodyField& motion, int group, const Vector3f& d) {
  const Vector3f t = motion.col(group).head<3>(), w = motion.col(group).segment<3>(3);
  return t + w.cross(d);
}

void append(const Eigen::Matrix<double, 6, 6>& block, std::vector<float>& blocks) {
  const Eigen::Matrix<float, 6, 6> rounded = block.cast<float>();
  blocks.insert(blocks.end(), rounded.data(), rounded.data() + rounded.size());
}

}  // namespace

/// A node with all its neighbours where none is in a group yet; what is left joins a neighbour's.
Multigrid::Groups Multigrid::group(const std::vector<int>& row_start, const std::vector<int>& column,
                                   const Matrix3Xd& X) {
  const int n = static_cast<int>(row_start.size()) - 1;
  Groups groups;
  groups.of.assign(n, -1);
  int n_groups = 0;
  for (int i = 0; i < n; ++i) {
    const auto begin = column.begin() + row_start[i], end = column.begin() + row_start[i + 1];
    if (std::any_of(begin, end, [&](int j) { return groups.of[j] >= 0; })) continue;
    for (auto j = begin; j != end; ++j) groups.of[*j] = n_groups;
    ++n_groups;
  }
  std::vector<int> joined = groups.of;
  for (int i = 0; i < n; ++i)
    for (int k = row_start[i]; k < row_start[i + 1] && joined[i] < 0; ++k) joined[i] = groups.of[column[k]];
  groups.of = joined;
  groups.centre = Matrix3Xd::Zero(3, n_groups);
  Eigen::VectorXd size = Eigen::VectorXd::Zero(n_groups);
  for (int i = 0; i < n; ++i) {
    groups.centre.col(groups.of[i]) += X.col(i);
    ++size(groups.of[i]);
  }
  groups.centre *= size.cwiseInverse().asDiagonal();
  groups.offset.resize(3, n);
  for (int i = 0; i < n; ++i) groups.offset.col(i) = X.col(i) - groups.centre.col(groups.of[i]);
  pad(groups.offset, 1, groups.rounded);
  return groups;
}

template <class Block>
Multigrid::Level Multigrid::level_of(const std::vector<int>& row_start, const std::vector<int>& column,
                                     const std::vector<Block>& block, const Groups& groups) {
  constexpr int D = Block::RowsAtCompileTime;
  const int n = static_cast<int>(groups.of.size()), n_groups = static_cast<int>(groups.centre.cols());
  std::vector<std::vector<int>> members(n_groups);
  for (int i = 0; i < n; ++i) members[groups.of[i]].push_back(i);
  Level level;
  BodyMatrix& A = level.A;
  std::vector<int> at(n_groups, -1);  // position of a column in the row at hand
  A.row_start.push_back(0);
  for (int g = 0; g < n_groups; ++g) {
    const size_t first = A.column.size();
    for (const int i : members[g])
      for (int k = row_start[i]; k < row_start[i + 1]; ++k)
        if (int& position = at[groups.of[column[k]]]; position < static_cast<int>(first)) {
          position = static_cast<int>(A.column.size());
          A.column.push_back(groups.of[column[k]]);
        }
    std::sort(A.column.begin() + first, A.column.end());
    for (size_t k = first; k < A.column.size(); ++k) at[A.column[k]] = static_cast<int>(k);
    level.block.resize(A.column.size(), Matrix6d::Zero());
    for (const int i : members[g]) {
      const auto P = prolongation<D>(groups.offset.col(i));
      for (int k = row_start[i]; k < row_start[i + 1]; ++k)
        level.block[at[groups.of[column[k]]]].noalias() +=
            P.transpose() * (block[k] * prolongation<D>(groups.offset.col(column[k])));
    }
    A.diagonal.push_back(at[g]);
    A.row_start.push_back(static_cast<int>(A.column.size()));
    append(pseudo_inverse(level.block[at[g]]), A.inverse);
  }
  for (const Matrix6d& block : level.block) append(block, A.block);
  for (std::vector<float>* blocks : {&A.block, &A.inverse}) blocks->resize(blocks->size() + 2);
  level.b.resize(8, n_groups);
  return level;
}

Multigrid::Multigrid(const LinearSystem& system, const std::vector<Eigen::Matrix3d>& inverse)
    : largest_(largest_eigenvalue(system, inverse)) {
  const BlockMatrix& A = system.matrix();
  groups_ = group(A.row_start, A.column, *system.positions);
  levels_.push_back(level_of(A.row_start, A.column, A.block, groups_));
  Matrix3Xd centre = groups_.centre;
  while (levels_.back().b.cols() > kCoarsest) {
    Level& fine = levels_.back();
    fine.groups = group(fine.A.row_start, fine.A.column, centre);
    centre = fine.groups.centre;
    if (centre.cols() == fine.b.cols()) break;
    Level coarse = level_of(fine.A.row_start, fine.A.column, fine.block, fine.groups);
    fine.block = {};
    levels_.push_back(std::move(coarse));
  }
  const Level& coarsest = levels_.back();
  const Eigen::Index n = coarsest.b.cols();
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(6 * n, 6 * n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (int k = coarsest.A.row_start[i]; k < coarsest.A.row_start[i + 1]; ++k)
      dense.block<6, 6>(6 * i, 6 * coarsest.A.column[k]) = coarsest.block[k];
  coarsest_inverse_ = pseudo_inverse(dense);
}

/// x of level l from its b: a W-cycle, with one sweep of block Gauss-Seidel down and one, backwards, up.
void Multigrid::cycle(size_t l) {
  Level& level = levels_[l];
  if (l + 1 == levels_.size()) {
    level.x.resize(8, level.b.cols());
    const Eigen::VectorXd b = level.b.topRows<6>().cast<double>().reshaped();
    level.x.topRows<6>().reshaped() = (coarsest_inverse_ * b).cast<float>();
    return;
  }
  const auto n = level.b.cols();
  Level& coarse = levels_[l + 1];
  const Groups& groups = level.groups;
  sweep_down(level.A, level.b, level.x);
  const int n_visits = l + 2 < levels_.size() ? 2 : 1;
  for (int visit = 0; visit < n_visits; ++visit) {
    residual(level.A, level.b, level.x, level.rest);
    coarse.b.setZero();
    for (Eigen::Index i = 0; i < n; ++i) {
      add_wrench(level.rest.col(i).head<3>(), groups.rounded.col(i).head<3>(), coarse.b, groups.of[i]);
      coarse.b.col(groups.of[i]).segment<3>(3) += level.rest.col(i).segment<3>(3);
    }
    cycle(l + 1);
    for (Eigen::Index i = 0; i < n; ++i) {
      level.x.col(i).head<3>() += translation(coarse.x, groups.of[i], groups.rounded.col(i).head<3>());
      level.x.col(i).segment<3>(3) += coarse.x.col(groups.of[i]).segment<3>(3);
    }
  }
  sweep_up(level.A, level.b, level.x);
}

void Multigrid::set_smoother(const std::vector<Eigen::Matrix3d>& inverse) {
  constexpr float kDamping =
      1.2f;  // over the largest eigenvalue: the upper half of the spectrum fades fastest
  smoother_ = pad(inverse);
  smoother_.diagonal *= kDamping / static_cast<float>(largest_);
  smoother_.off_diagonal *= kDamping / static_cast<float>(largest_);
}

double Multigrid::apply(const LinearSystem& A, const PaddedField& r, PaddedField& z) {
  constexpr float kOvershoot = 1.5f;  // groups that move as rigid bodies are too stiff [Braess 1995]
  const auto n = static_cast<Eigen::Index>(groups_.of.size());
  multiply(smoother_, r, z);
  A.rounded_sparse_product(z, Az_);
  Level& coarse = levels_.front();
  coarse.b.setZero();
  for (Eigen::Index i = 0; i < n; ++i)
    add_wrench((r.col(i) - Az_.col(i)).head<3>(), groups_.rounded.col(i).head<3>(), coarse.b, groups_.of[i]);
  cycle(0);
  for (Eigen::Index i = 0; i < n; ++i)
    z.col(i).head<3>() += kOvershoot * translation(coarse.x, groups_.of[i], groups_.rounded.col(i).head<3>());
  A.rounded_filter(z);
  A.rounded_sparse_product(z, Az_);
  return correct(smoother_, r, Az_, z);
}

}  // namespace testbed::meshing
