#include "meshing/algebra/strong_couplings.h"

#include <algorithm>
#include <optional>

#include "meshing/algebra/cholesky.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3f;
using Eigen::Matrix3Xd;

Matrix3f block_at(const std::vector<float>& blocks, int k) {
  return Matrix3f::Map(&blocks[9 * static_cast<std::size_t>(k)]);
}

/// Nodes with a coupling beyond so many times the median, over the distance: a tetrahedron's grow as it gets flat.
std::vector<int> strongly_coupled(const BlockMatrix& A, const std::vector<float>& blocks,
                                  const Matrix3Xd& X) {
  constexpr double kStrong = 30;
  constexpr int kSample = 10000;  // rows, of which a median is taken
  const auto square_of_strength = [&](int i, int k) {
    return block_at(blocks, k).cast<double>().squaredNorm() / (X.col(i) - X.col(A.column[k])).squaredNorm();
  };
  std::vector<double> some;
  for (int i = 0; i < A.rows(); i += 1 + A.rows() / kSample)
    for (int k = A.diagonal[i] + 1; k < A.row_start[i + 1]; ++k)
      if (const double s = square_of_strength(i, k); s > 0) some.push_back(s);  // not where constrained
  if (some.empty()) return {};
  const auto middle = some.begin() + static_cast<std::ptrdiff_t>(some.size() / 2);
  std::nth_element(some.begin(), middle, some.end());
  const double bound = kStrong * kStrong * *middle;
  std::vector<char> is_strong(A.rows(), 0);
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.diagonal[i] + 1; k < A.row_start[i + 1]; ++k)
      if (square_of_strength(i, k) > bound) is_strong[i] = is_strong[A.column[k]] = 1;
  std::vector<int> nodes;
  for (int i = 0; i < A.rows(); ++i)
    if (is_strong[i]) nodes.push_back(i);
  return nodes;
}

}  // namespace

StrongCouplings::StrongCouplings(const BlockMatrix& A, const std::vector<float>& blocks, const Matrix3Xd& X)
    : nodes_(strongly_coupled(A, blocks, X)) {
  constexpr double kSinglePrecision = 1e-6;  // a part of the diagonal that keeps what is rounded definite
  if (nodes_.empty()) return;
  std::vector<int> number(A.rows(), -1);
  for (int i = 0; i < n_nodes(); ++i) number[nodes_[i]] = i;
  BlockMatrix part;
  part.row_start = row_start_ = {0};
  for (const int i : nodes_) {
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k) {
      column_.push_back(A.column[k]);
      const auto at = blocks.begin() + 9 * static_cast<std::ptrdiff_t>(k);
      block_.insert(block_.end(), at, at + 9);
      if (number[A.column[k]] < 0) continue;
      if (A.column[k] == i) part.diagonal.push_back(static_cast<int>(part.column.size()));
      part.column.push_back(number[A.column[k]]);
      part.block.push_back(block_at(blocks, k).cast<double>());
    }
    row_start_.push_back(static_cast<int>(column_.size()));
    part.row_start.push_back(static_cast<int>(part.column.size()));
  }
  for (const int k : part.diagonal) part.block[k].diagonal() *= 1 + kSinglePrecision;
  std::optional<BlockCholesky> cholesky;
  if (n_factor_entries(part) <= kMostFactorEntries) cholesky.emplace(part);
  if (cholesky && cholesky->is_ok())
    factor_ = cholesky->single_precision();
  else
    *this = {};
}

void StrongCouplings::begin(const PaddedField& r, PaddedField& z, PaddedField& rest) const {
  PaddedField part = PaddedField::Zero(4, padded(n_nodes())), moved;
  for (int i = 0; i < n_nodes(); ++i) part.col(i) = r.col(nodes_[i]);
  factor_.solve(part, moved);
  z.setZero(4, r.cols());
  rest = r;
  for (int i = 0; i < n_nodes(); ++i) {
    z.col(nodes_[i]) = moved.col(i);
    for (int k = row_start_[i]; k < row_start_[i + 1]; ++k)  // A is symmetric: its rows are its columns
      rest.col(column_[k]).head<3>().noalias() -= block_at(block_, k).transpose() * moved.col(i).head<3>();
  }
}

void StrongCouplings::end(const PaddedField& r, PaddedField& z) const {
  PaddedField part = PaddedField::Zero(4, padded(n_nodes())), moved;
  for (int i = 0; i < n_nodes(); ++i) {
    Eigen::Vector3f rest = r.col(nodes_[i]).head<3>();
    for (int k = row_start_[i]; k < row_start_[i + 1]; ++k)
      rest.noalias() -= block_at(block_, k) * z.col(column_[k]).head<3>();
    part.col(i).head<3>() = rest;
  }
  factor_.solve(part, moved);
  for (int i = 0; i < n_nodes(); ++i) z.col(nodes_[i]) += moved.col(i);
}

}  // namespace testbed::meshing
