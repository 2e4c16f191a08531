// Algebraic multigrid of several processes, by smoothed aggregation (Trilinos ML).
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "meshing/algebra/block_matrix.h"

namespace testbed::fem {

/// A V-cycle for a symmetric matrix of three unknowns to a node, as a preconditioner
/// of conjugate gradients [Vanek, Mandel & Brezina 1996].
class AlgebraicMultigrid {
 public:
  /// @param A          this process' rows come first, and count
  /// @param near_null  vectors that the matrix takes (nearly) to zero over these rows: rigid motions
  /// @param number     of each row's node in all processes
  AlgebraicMultigrid(const meshing::BlockMatrix& A, Eigen::MatrixXd near_null,
                     const std::vector<int>& number);
  ~AlgebraicMultigrid();

  /// Of this process' rows.
  Eigen::VectorXd apply(const Eigen::VectorXd& r) const;

 private:
  struct Hierarchy;
  std::unique_ptr<Hierarchy> hierarchy_;
};

}  // namespace testbed::fem
