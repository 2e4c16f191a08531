// The triangular solves of a Cholesky factor in single precision: half the bytes, which bound them.
#pragma once

#include <vector>

#include "meshing/algebra/single_precision.h"
#include "meshing/base/archive.h"

namespace testbed::meshing {

/// A factor L of a permuted symmetric matrix of 3 x 3 blocks. Neighbouring columns with the same
/// rows below them form a supernode, whose columns are dense [Chen, Davis, Hager & Rajamanickam 2008].
struct SinglePrecisionFactor {
  struct Supernode {
    int first, n_columns;  ///< its columns of L
    int n_rows;            ///< with those of its columns
    int height;            ///< of a column as stored: n_rows and zeros, a multiple of 8
    std::size_t rows;      ///< where those below its columns begin in `row`
    std::size_t entries;   ///< where its columns begin in `entry`
  };
  std::vector<Supernode> supernodes;
  std::vector<int> row;               ///< of L
  std::vector<float> entry;           ///< below the diagonal; zeros on it and above
  std::vector<float> inverse;         ///< of the diagonal of L
  std::vector<Eigen::Index> unknown;  ///< 4 node + component of each row of L

  /// z = A^-1 r; r . z.
  double solve(const PaddedField& r, PaddedField& z) const;
  /// A^-1 r, 3 x n, whatever the size of r.
  Eigen::Matrix3Xd solve(const Eigen::Matrix3Xd& r) const;
};

inline void archive(Archive& a, SinglePrecisionFactor::Supernode& s) {
  a(s.first, s.n_columns, s.n_rows, s.height, s.rows, s.entries);
}
inline void archive(Archive& a, SinglePrecisionFactor& factor) {
  a(factor.supernodes, factor.row, factor.entry, factor.inverse, factor.unknown);
}

}  // namespace testbed::meshing
