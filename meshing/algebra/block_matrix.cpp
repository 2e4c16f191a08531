#include "meshing/algebra/block_matrix.h"

#include <algorithm>
#include <array>
#include <cassert>

#include "meshing/algebra/subdomains.h"

namespace testbed::meshing {

int BlockMatrix::find(int i, int j) const {
  const int at = find_any(i, j);
  assert(at >= 0);
  return at;
}

int BlockMatrix::find_any(int i, int j) const {
  const int* at = column.data() + row_start[i];
  for (int n = row_start[i + 1] - row_start[i]; n > 1;) {  // no branch depends on what is compared
    const int half = n / 2;
    at += at[half] <= j ? half : 0;
    n -= half;
  }
  return *at == j ? static_cast<int>(at - column.data()) : -1;
}

void BlockMatrix::set_zero() {
  std::fill(block.begin(), block.end(), Eigen::Matrix3d::Zero());
}

BlockMatrix make_block_matrix(int n, const Eigen::Matrix2Xi& pairs) {
  std::vector<std::vector<int>> rows(n);
  for (int i = 0; i < n; ++i) rows[i].push_back(i);
  for (const auto& pair : pairs.colwise()) {
    rows[pair(0)].push_back(pair(1));
    rows[pair(1)].push_back(pair(0));
  }
  BlockMatrix A;
  A.row_start.push_back(0);
  for (std::vector<int>& row : rows) {
    std::sort(row.begin(), row.end());
    row.erase(std::unique(row.begin(), row.end()), row.end());
    A.column.insert(A.column.end(), row.begin(), row.end());
    A.row_start.push_back(static_cast<int>(A.column.size()));
  }
  for (int i = 0; i < n; ++i) A.diagonal.push_back(A.find(i, i));
  A.block.assign(A.column.size(), Eigen::Matrix3d::Zero());
  return A;
}

BlockMatrix with_blocks(const BlockMatrix& A, const std::vector<SymmetricBlock>& blocks) {
  std::vector<std::array<int, 2>> pairs;
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.diagonal[i] + 1; k < A.row_start[i + 1]; ++k) pairs.push_back({i, A.column[k]});
  for (const SymmetricBlock& b : blocks)
    if (A.find_any(b.i, b.j) < 0) pairs.push_back({b.i, b.j});
  BlockMatrix sum = make_block_matrix(
      A.rows(),
      Eigen::Map<const Eigen::Matrix2Xi>(pairs.data()->data(), 2, static_cast<Eigen::Index>(pairs.size())));
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      sum.block[sum.find(i, A.column[k])] = A.block[k];
  for (const SymmetricBlock& b : blocks) {
    sum.block[sum.find(b.i, b.j)] += b.block;
    if (b.i != b.j) sum.block[sum.find(b.j, b.i)] += b.block.transpose();
  }
  return sum;
}

void mirror(BlockMatrix& A) {
  std::vector<int> next(A.row_start.begin(), A.row_start.end() - 1);  // in each row; they fill in order
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.diagonal[i] + 1; k < A.row_start[i + 1]; ++k)
      A.block[next[A.column[k]]++] = A.block[k].transpose();
}

template <class Real>
void symmetrise(const BlockMatrix& pattern, Real* blocks) {
  using Block = Eigen::Map<Eigen::Matrix<Real, 3, 3>>;
  std::vector<int> next(pattern.row_start.begin(), pattern.row_start.end() - 1);
  for (int i = 0; i < pattern.rows(); ++i)
    for (int k = pattern.diagonal[i] + 1; k < pattern.row_start[i + 1]; ++k) {
      Block upper(blocks + 9 * static_cast<std::ptrdiff_t>(k)),
          lower(blocks + 9 * static_cast<std::ptrdiff_t>(next[pattern.column[k]]++));
      upper += lower.transpose();
      lower = upper.transpose();
    }
}
template void symmetrise(const BlockMatrix& pattern, float* blocks);
template void symmetrise(const BlockMatrix& pattern, double* blocks);

template <class Real>
void hold(const BlockMatrix& pattern, const std::vector<char>& is_constrained, Real* blocks) {
  std::vector<char> has_constrained(pattern.rows());
  for (int i = 0; i < pattern.rows(); ++i)
    has_constrained[i] = is_constrained[3 * i] || is_constrained[3 * i + 1] || is_constrained[3 * i + 2];
  for (int i = 0; i < pattern.rows(); ++i)
    for (int k = pattern.row_start[i]; k < pattern.row_start[i + 1]; ++k) {
      const int j = pattern.column[k];
      if (!has_constrained[i] && !has_constrained[j]) continue;
      Real* block = blocks + 9 * static_cast<std::ptrdiff_t>(k);
      for (int d = 0; d < 3; ++d)
        for (int c = 0; c < 3; ++c)
          if ((is_constrained[3 * i + c] || is_constrained[3 * j + d]) && (i != j || c != d))
            block[3 * d + c] = 0;
    }
}
template void hold(const BlockMatrix& pattern, const std::vector<char>& is_constrained, float* blocks);
template void hold(const BlockMatrix& pattern, const std::vector<char>& is_constrained, double* blocks);

void multiply(const BlockMatrix& A, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) {
  y.resize(3, A.rows());
  for_each_chunk(A.rows(), [&](Eigen::Index begin, Eigen::Index end) {
    for (Eigen::Index i = begin; i < end; ++i) {
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k) sum += A.block[k] * x.col(A.column[k]);
      y.col(i) = sum;
    }
  });
}

std::vector<float> single_precision(const BlockMatrix& A) {
  std::vector<float> blocks(9 * A.block.size() + 3);
  for (size_t k = 0; k < A.block.size(); ++k) Eigen::Matrix3f::Map(&blocks[9 * k]) = A.block[k].cast<float>();
  return blocks;
}

double add_product(const BlockMatrix& pattern, const std::vector<float>& blocks, const PaddedField& p,
                   PaddedField& y) {
  return add_product(pattern.row_start, pattern.column, blocks, p, y);
}

}  // namespace testbed::meshing
