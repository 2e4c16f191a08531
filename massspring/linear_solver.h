// The linear systems of implicit steps.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "massspring/cholesky.h"
#include "massspring/conjugate_gradients.h"

namespace testbed {

/// Conjugate gradients on (A + g g^T) x = b, preconditioned by the inverse diagonal blocks of A until these
/// need too many iterations, then, where its fill is affordable, by a Cholesky factor that is kept from
/// matrix to matrix while it serves.
class LinearSolver {
 public:
  /// @param A  symmetric positive definite
  /// @param g  3 x n; A stays sparse, as the rank-one term is only ever applied
  SolveReport solve(const BlockMatrix& A, const std::optional<Eigen::Matrix3Xd>& g, const Eigen::Matrix3Xd& b,
                    Eigen::Matrix3Xd& x, double tolerance);

  /// The preconditioner in use and why.
  const std::string& choice() const { return choice_; }

 private:
  SolveReport solve_by_factor(const BlockMatrix& A, const std::optional<Eigen::Matrix3Xd>& g,
                              const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance);

  std::unique_ptr<BlockCholesky> factor_;
  std::vector<Eigen::Matrix3d> inverse_diagonal_;
  std::string choice_ = "block Jacobi: no system was hard so far";
};

}  // namespace testbed
