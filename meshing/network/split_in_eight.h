// Tetrahedra and the triangles around them halved in every direction.
#pragma once

#include "meshing/base/mesh.h"

namespace testbed::meshing {

struct SplitNetwork {
  SpringNetwork network;     ///< of the same body, without springs; its first nodes are the surface's before
  Eigen::Matrix2Xi between;  ///< 2 x n: nodes before that each lies halfway between, one twice where it stood
};

/// Splits every tetrahedron in eight at the middles of its edges, the octahedron that four corners leave along its
/// shortest diagonal [Bey 1995], and every triangle of the surface in four. What the surface was cut from stays known.
SplitNetwork split_in_eight(const SpringNetwork& network);

/// A field (3 x n) that is linear in the tetrahedra before, at the nodes after.
Eigen::Matrix3Xd interpolated(const Eigen::Matrix3Xd& field, const Eigen::Matrix2Xi& between);

}  // namespace testbed::meshing
