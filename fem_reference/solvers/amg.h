// Algebraic multigrid by smoothed aggregation (Trilinos ML).
#pragma once

#include <Eigen/Core>
#include <memory>

#include "meshing/algebra/block_matrix.h"

class Epetra_RowMatrix;
namespace ML_Epetra {
class MultiLevelPreconditioner;
}

namespace testbed::fem {

/// The hierarchy of a matrix with three unknowns to a node. Both arguments must outlive it.
/// @param near_null  vectors that the matrix takes (nearly) to zero, over this process' unknowns
std::shared_ptr<ML_Epetra::MultiLevelPreconditioner> make_multigrid(const Epetra_RowMatrix& matrix,
                                                                    Eigen::MatrixXd& near_null);

/// A V-cycle for a symmetric matrix, as a preconditioner
/// of conjugate gradients [Vanek, Mandel & Brezina 1996].
class AlgebraicMultigrid {
 public:
  /// @param near_null  vectors that the matrix takes (nearly) to zero: rigid motions
  AlgebraicMultigrid(const meshing::BlockMatrix& A, Eigen::MatrixXd near_null);
  ~AlgebraicMultigrid();

  Eigen::VectorXd apply(const Eigen::VectorXd& r) const;

 private:
  struct Hierarchy;
  std::unique_ptr<Hierarchy> hierarchy_;
};

}  // namespace testbed::fem
