// Rows of square blocks in single precision, as the levels of a multigrid have them.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/single_precision.h"
#include "meshing/base/archive.h"

namespace testbed::meshing {

/// Motions of rigid bodies, or forces and torques on them, padded to eight rows that do not count.
using BodyField = Eigen::Matrix<float, 8, Eigen::Dynamic>;

/// Fields of nodes (D = 3) or of rigid bodies (D = 6).
template <int D>
using FieldOf = std::conditional_t<D == 3, PaddedField, BodyField>;

/// Compressed rows of D x D blocks by columns, and two more floats at the end.
template <int D>
struct BlockRows {
  std::vector<int> row_start, column, diagonal;
  std::vector<float> block, inverse;  ///< inverse: of the diagonal blocks

  Eigen::Index n_rows() const { return static_cast<Eigen::Index>(row_start.size()) - 1; }
};

/// How D components of each row follow rigid bodies: compressed rows of blocks 6 x D, the transposes of what
/// takes a body's motion to them, by columns, and two more floats at the end.
template <int D>
struct BodyRows {
  std::vector<int> row_start, column;
  std::vector<float> block;
};

template <int D>
void archive(Archive& a, BlockRows<D>& rows) {
  a(rows.row_start, rows.column, rows.diagonal, rows.block, rows.inverse);
}
template <int D>
void archive(Archive& a, BodyRows<D>& rows) {
  a(rows.row_start, rows.column, rows.block);
}

/// y = A x.
template <int D>
void multiply(const BlockRows<D>& A, const FieldOf<D>& x, FieldOf<D>& y);

/// y = A^-1 x, of A the diagonal blocks alone.
template <int D>
void multiply_inverse(const BlockRows<D>& A, const FieldOf<D>& x, FieldOf<D>& y);

/// x = (L + D)^-1 b, L and D the part of A below its diagonal and on it: a sweep of block Gauss-Seidel from
/// zero.
template <int D>
void sweep_down(const BlockRows<D>& A, const FieldOf<D>& b, FieldOf<D>& x);

/// r = b - A x right after that sweep, which is -U x, U the part of A above its diagonal.
template <int D>
void rest_of_sweep(const BlockRows<D>& A, const FieldOf<D>& x, FieldOf<D>& r);

/// x += (D + U)^-1 (b - A x): a sweep backwards.
template <int D>
void sweep_up(const BlockRows<D>& A, const FieldOf<D>& b, FieldOf<D>& x);

/// wrench = P^T r, the forces r as the bodies feel them; wrench has its size.
template <int D>
void gather(const BodyRows<D>& P, const FieldOf<D>& r, BodyField& wrench);

/// x += P motion.
template <int D>
void add_motion(const BodyRows<D>& P, const BodyField& motion, FieldOf<D>& x);

}  // namespace testbed::meshing
