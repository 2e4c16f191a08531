// A sparse matrix of 3 x 3 blocks, one row and column per node.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/single_precision.h"

namespace testbed::meshing {

/// A second derivative as it is, or with its negative eigenvalues set to 0: exact converges quadratically,
/// projected always descends. In between, angles of a skin count as linear in the positions: in a single
/// linearised step their own second derivatives gain energy.
enum class Curvature { Exact, Projected, ExactButAngles };

/// A block at i and j of a symmetric matrix, which has its transpose at j and i.
struct SymmetricBlock {
  int i, j;
  Eigen::Matrix3d block;
};

/// y += A p on the first three rows, A the sum of blocks.
template <class Field>
void add_product(const std::vector<SymmetricBlock>& blocks, const Field& p, Field& y) {
  for (const SymmetricBlock& b : blocks) {
    const auto block = b.block.template cast<typename Field::Scalar>();
    y.col(b.i).template head<3>() += block * p.col(b.j).template head<3>();
    if (b.i != b.j) y.col(b.j).template head<3>() += block.transpose() * p.col(b.i).template head<3>();
  }
}

/// Block compressed rows; columns ascend in a row; the pattern is symmetric and holds the diagonal.
struct BlockMatrix {
  std::vector<int> row_start;          ///< n + 1
  std::vector<int> column;             ///< n_blocks
  std::vector<Eigen::Matrix3d> block;  ///< n_blocks
  std::vector<int> diagonal;           ///< position of each diagonal block, n
  /// Positions that an energy adds to, kept from one time to the next, and the hash of what they follow from.
  std::vector<int> kept;
  std::size_t kept_of = 0;

  int rows() const { return static_cast<int>(row_start.size()) - 1; }
  /// Position of block (i, j), which must be in the pattern.
  int find(int i, int j) const;
  /// The same, or -1 where the pattern has none.
  int find_any(int i, int j) const;
  void set_zero();
};

/// Zero matrix of n rows whose pattern is the diagonal and the given node pairs (2 x m, any order, repeats
/// allowed).
BlockMatrix make_block_matrix(int n, const Eigen::Matrix2Xi& pairs);

/// A with blocks that its pattern need not have.
BlockMatrix with_blocks(const BlockMatrix& A, const std::vector<SymmetricBlock>& blocks);

/// Copies the blocks above the diagonal, transposed, to below it.
void mirror(BlockMatrix& A);

/// Of two entries that belong to the same pair of unknowns makes their sum: a triangle of a matrix, or parts
/// of it on both sides of the diagonal, becomes the whole. Blocks of the pattern, 9 numbers each by columns.
template <class Real>
void symmetrise(const BlockMatrix& pattern, Real* blocks);

/// Empties rows and columns of constrained unknowns (3 row + component) but for the diagonal.
template <class Real>
void hold(const BlockMatrix& pattern, const std::vector<char>& is_constrained, Real* blocks);

/// y = A x for 3 x n fields of node vectors.
void multiply(const BlockMatrix& A, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y);

/// The blocks in single precision, by columns, and three floats at the end.
std::vector<float> single_precision(const BlockMatrix& A);

/// y += A p of blocks in single precision; then p . y.
double add_product(const BlockMatrix& pattern, const std::vector<float>& blocks, const PaddedField& p,
                   PaddedField& y);

}  // namespace testbed::meshing
