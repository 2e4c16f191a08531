// The consistent mass of tetrahedra, beside that lumped at their nodes.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/block_matrix.h"

namespace testbed::massspring {

/// What tells the consistent mass matrix of linear tetrahedra from masses m at nodes:
///   M = diag(m) - R,  R = sum over edges ij of r (d_i - d_j)(d_i - d_j)^T, [(20)]
/// r a twentieth of the mass of the tetrahedra around the edge. Total mass and momentum are the same; the
/// inertia that nodes exaggerate, as they lie at the corners of what they stand for, is not.
struct ConsistentMass {
  Eigen::Matrix2Xi E;  ///< edges of the tetrahedra, 2 x m
  Eigen::VectorXd r;   ///< kg
};

/// X 3 x n (m), T 4 x m of positive volume, rho in kg/m3.
ConsistentMass consistent_mass(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, double rho);

/// Lumps at its nodes the mass of every edge that meets one of `nodes`, ascending. Implicit steps do not
/// know the acceleration of nodes whose motion is prescribed, which mass between the nodes would pass on to
/// their neighbours.
void lump(const std::vector<int>& nodes, ConsistentMass& mass);

/// y += factor R p on the first three rows.
template <class Field>
void add_product(const ConsistentMass& mass, double factor, const Field& p, Field& y) {
  using Scalar = typename Field::Scalar;
  for (Eigen::Index e = 0; e < mass.E.cols(); ++e) {
    const int i = mass.E(0, e), j = mass.E(1, e);
    const Eigen::Matrix<Scalar, 3, 1> exchanged =
        static_cast<Scalar>(factor * mass.r(e)) * (p.col(i).template head<3>() - p.col(j).template head<3>());
    y.col(i).template head<3>() += exchanged;
    y.col(j).template head<3>() -= exchanged;
  }
}

/// Adds the diagonal blocks of factor R to those of each node.
void add_diagonal(const ConsistentMass& mass, double factor, std::vector<Eigen::Matrix3d>& blocks);

/// A += factor R; A's pattern must hold the edges.
void add_blocks(const ConsistentMass& mass, double factor, BlockMatrix& A);

}  // namespace testbed::massspring
