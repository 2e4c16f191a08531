// Sparse Cholesky factorisation of a block matrix.
#pragma once

#include <Eigen/SparseCore>
#include <memory>
#include <optional>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/single_precision_factor.h"
#include "meshing/base/archive.h"

namespace testbed::meshing {

constexpr double kMostFactorEntries = 2e8;  ///< that are affordable: 1.6 GB

/// Entries that the factor of a matrix would have, whose order cuts fill.
double n_factor_entries(const BlockMatrix& A);

/// Supernodal Cholesky factor (CHOLMOD) of a symmetric positive definite matrix, whose lower triangle is read.
class SparseCholesky {
 public:
  /// @throws std::runtime_error where the factor has more entries than CHOLMOD counts, or than fit in memory
  explicit SparseCholesky(const Eigen::SparseMatrix<double>& A);
  ~SparseCholesky();
  SparseCholesky(SparseCholesky&&) noexcept;
  SparseCholesky& operator=(SparseCholesky&&) noexcept;

  /// Factorises another matrix of as many unknowns. The analysis of the same pattern is kept; of another one the
  /// first matrix' order, while the factor hardly grows by it: to find an order takes as long as to factorise.
  void update(const Eigen::SparseMatrix<double>& A);

  /// False when the matrix was not positive definite: then solve may not be called.
  bool is_ok() const;
  /// A^-1 b of one or many columns. The factor is read once for all, not once for each.
  Eigen::MatrixXd solve(const Eigen::MatrixXd& b) const;
  /// The factor in single precision, which takes a third of the time of solve. Under the same condition. Three
  /// unknowns share a column of the fields that it solves for.
  SinglePrecisionFactor single_precision() const;

 private:
  void check_analysis() const;
  void factorise(const Eigen::SparseMatrix<double>& A);

  struct Factor;
  std::unique_ptr<Factor> factor_;
};

/// The same of a block matrix.
class BlockCholesky {
 public:
  BlockCholesky() = default;  ///< to be read from an archive
  explicit BlockCholesky(const BlockMatrix& A);
  /// As the matrix that is factorised, which gives the same factor.
  friend void archive(Archive& a, BlockCholesky& cholesky);

  void update(const BlockMatrix& A);
  bool is_ok() const { return factor_->is_ok(); }
  std::size_t n_blocks() const { return n_blocks_; }  ///< of the matrix
  /// x = A^-1 b, 3 x n.
  void solve(const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x) const;
  /// A^-1 b for many columns at once, b of 3n x m.
  Eigen::MatrixXd solve_columns(const Eigen::MatrixXd& b) const { return factor_->solve(b); }
  SinglePrecisionFactor single_precision() const { return factor_->single_precision(); }

 private:
  std::size_t n_blocks_ = 0;
  Eigen::SparseMatrix<double> lower_;
  std::optional<SparseCholesky> factor_;
};

}  // namespace testbed::meshing
