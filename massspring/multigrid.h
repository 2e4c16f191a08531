// Aggregation multigrid for the linear systems of implicit steps.
#pragma once

#include <vector>

#include "massspring/linear_system.h"

namespace testbed {

/// Preconditioner that moves groups of neighbouring nodes as rigid bodies, groups of groups likewise, and so
/// on [Vanek et al. 1996; Braess 1995]: rigid motions cost no elastic energy, so that what smoothing leaves
/// is what few rigid bodies can follow. Groups have the matrix of the system it was made of; the nodes
/// themselves are smoothed by damped block Jacobi with the system at hand.
class Multigrid {
 public:
  /// @param inverse  of the system's diagonal blocks
  Multigrid(const LinearSystem& system, const std::vector<Eigen::Matrix3d>& inverse);

  /// z = a symmetric positive definite approximation of A^-1 r, 3 x n, A without its rank-one part.
  void apply(const LinearSystem& A, const std::vector<Eigen::Matrix3d>& inverse, const Eigen::Matrix3Xd& r,
             Eigen::Matrix3Xd& z);

 private:
  using Vector6d = Eigen::Matrix<double, 6, 1>;
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  struct Groups {
    std::vector<int> of;      ///< group of each member
    Eigen::Matrix3Xd offset;  ///< of each member from the centre of its group (m)
    Eigen::Matrix3Xd centre;  ///< of each group (m)
  };
  static Groups group(const std::vector<int>& row_start, const std::vector<int>& column,
                      const Eigen::Matrix3Xd& X);

  /// Rigid bodies: their matrix over translations and rotations about their centres.
  struct Level {
    std::vector<int> row_start, column, diagonal;
    std::vector<Matrix6d> block, inverse;
    Groups groups;  ///< that they form on the next level
    Eigen::Matrix<double, 6, Eigen::Dynamic> x, b;
  };
  template <class Block>
  static Level level_of(const std::vector<int>& row_start, const std::vector<int>& column,
                        const std::vector<Block>& block, const Groups& groups);
  void cycle(size_t l);

  double largest_;  ///< eigenvalue of A with its diagonal blocks scaled to ones
  Groups groups_;
  std::vector<Level> levels_;
  Eigen::MatrixXd coarsest_inverse_;
  Eigen::Matrix3Xd Az_;
};

}  // namespace testbed
