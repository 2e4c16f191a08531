// Sparse Cholesky factorisation of a block matrix.
#pragma once

#include <memory>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/rounded_factor.h"

namespace testbed::meshing {

/// Entries that the factor of a matrix would have, whose order cuts fill.
double n_factor_entries(const BlockMatrix& A);

/// Supernodal Cholesky factor (CHOLMOD) of a symmetric positive definite block matrix.
class BlockCholesky {
 public:
  explicit BlockCholesky(const BlockMatrix& A);
  ~BlockCholesky();

  /// Factorises another matrix of the same pattern, whose analysis is kept.
  void update(const BlockMatrix& A);

  /// False when the matrix was not positive definite: then solve may not be called.
  bool is_ok() const;
  /// x = A^-1 b, 3 x n.
  void solve(const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x) const;
  /// A^-1 b for many columns at once, b of 3n x m. The factor is read once for all, not once for each.
  Eigen::MatrixXd solve_columns(const Eigen::MatrixXd& b) const;
  /// The factor in single precision, which takes a third of the time of solve. Under the same condition.
  RoundedFactor rounded() const;

 private:
  struct Factor;
  std::unique_ptr<Factor> factor_;
};

}  // namespace testbed::meshing
