// Multigrid for elastic systems: of smoothed aggregates, and of nodes that halve the edges of others.
#pragma once

#include <functional>
#include <vector>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/block_rows.h"
#include "meshing/algebra/strong_couplings.h"

namespace testbed::meshing {

/// z = a symmetric positive definite approximation of A^-1 r.
using SinglePreconditioner = std::function<void(const PaddedField& r, PaddedField& z)>;

/// Preconditioner of elastic systems: groups of neighbouring nodes move as rigid bodies, groups of groups
/// likewise, and so on. These motions are smoothed by one step of damped block Jacobi, so that bodies blend
/// into each other [Vanek, Mandel & Brezina 1996]. A V-cycle with a sweep of block Gauss-Seidel down and one,
/// backwards, up, in single precision; nodes of flat tetrahedra are corrected together.
class Multigrid {
 public:
  /// @param A          symmetric positive definite, in constrained directions regular and without coupling
  /// @param X          positions of its nodes, 3 x n (m)
  /// @param constrain  takes constrained directions away from a field of nodes (3 x n)
  Multigrid(const BlockMatrix& A, const Eigen::Matrix3Xd& X,
            const std::function<void(Eigen::Matrix3Xd&)>& constrain);

  Multigrid() = default;  ///< to be read from an archive
  friend void archive(Archive& a, Multigrid& multigrid) {
    archive_level(a, multigrid.nodes_);
    a(multigrid.bodies_, multigrid.coarsest_inverse_, multigrid.strong_);
  }

  /// z = a symmetric positive definite approximation of A^-1 r; r . z.
  double apply(const PaddedField& r, PaddedField& z);

 private:
  /// Equations of nodes (D = 3) or rigid bodies (D = 6), and how these follow the bodies of the next level.
  template <int D>
  struct Level {
    BlockRows<D> A;
    BodyRows<D> P;
    FieldOf<D> rest;
  };
  /// Of a level of bodies.
  struct Bodies : Level<6> {
    BodyField x, b;
  };
  template <int D>
  static void archive_level(Archive& a, Level<D>& level) {
    a(level.A, level.P, level.rest);
  }
  friend void archive(Archive& a, Bodies& bodies) {
    archive_level<6>(a, bodies);
    a(bodies.x, bodies.b);
  }
  void cycle(size_t l);

  Level<3> nodes_;
  std::vector<Bodies> bodies_;
  Eigen::MatrixXf coarsest_inverse_;
  StrongCouplings strong_;
};

/// Preconditioner of an elastic system whose nodes halve the edges of another one's: a sweep of block Gauss-Seidel down,
/// the other's preconditioner on what is left, and a sweep backwards, up, in single precision [Brandt 1977]. Nodes of flat
/// tetrahedra are corrected together.
class TwoGrid {
 public:
  /// @param A, X     as for Multigrid
  /// @param between  2 x n: the other's nodes in whose middle each node lies; the same twice where it is one of them
  /// @param coarser  of the other system; keeps its constrained directions at rest
  TwoGrid(const BlockMatrix& A, const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& between,
          SinglePreconditioner coarser);

  /// z = a symmetric positive definite approximation of A^-1 r; r . z.
  double apply(const PaddedField& r, PaddedField& z);

 private:
  BlockRows<3> A_;
  StrongCouplings strong_;
  Eigen::Matrix2Xi between_;
  SinglePreconditioner coarser_;
  PaddedField rest_, coarse_rest_, coarse_;
};

}  // namespace testbed::meshing
