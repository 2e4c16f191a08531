// Aggregation multigrid for the linear systems of implicit steps.
#pragma once

#include <vector>

#include "meshing/algebra/linear_system.h"

namespace testbed::meshing {

/// Preconditioner that moves groups of neighbouring nodes as rigid bodies, groups of groups likewise,
/// and so on [Vanek, Mandel & Brezina 1996; Braess 1995]: rigid motions cost no elastic energy,
/// so that what smoothing leaves is what few rigid bodies can follow. Groups have the matrix of the system
/// it was made of; the nodes themselves are smoothed by damped block Jacobi with the system at hand.
class Multigrid {
 public:
  /// @param inverse  of the system's diagonal blocks
  Multigrid(const LinearSystem& system, const std::vector<Eigen::Matrix3d>& inverse);

  /// From the inverse of the diagonal blocks of the system at hand.
  void set_smoother(const std::vector<Eigen::Matrix3d>& inverse);

  /// z = a symmetric positive definite approximation of A^-1 r, A without its rank-one part; r . z.
  double apply(const LinearSystem& A, const PaddedField& r, PaddedField& z);

 private:
  using Matrix6d = Eigen::Matrix<double, 6, 6>;

  struct Groups {
    std::vector<int> of;      ///< group of each member
    Eigen::Matrix3Xd offset;  ///< of each member from the centre of its group (m)
    PaddedField rounded;      ///< offset
    Eigen::Matrix3Xd centre;  ///< of each group (m)
  };
  static Groups group(const std::vector<int>& row_start, const std::vector<int>& column,
                      const Eigen::Matrix3Xd& X);

  /// Rigid bodies: their matrix over translations and rotations about their centres.
  struct Level {
    BodyMatrix A;
    std::vector<Matrix6d> block;  ///< of A before rounding, until the next level is made
    Groups groups;                ///< that they form on the next level
    BodyField x, b, rest;
  };
  template <class Block>
  static Level level_of(const std::vector<int>& row_start, const std::vector<int>& column,
                        const std::vector<Block>& block, const Groups& groups);
  void cycle(size_t l);

  double largest_;  ///< eigenvalue of A with its diagonal blocks scaled to ones
  Groups groups_;
  std::vector<Level> levels_;
  Eigen::MatrixXd coarsest_inverse_;
  SymmetricBlocks smoother_;
  PaddedField Az_;
};

}  // namespace testbed::meshing
