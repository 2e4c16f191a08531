// How long edges inside a body should be.
#pragma once

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Mean length of the edges at each vertex (m).
Eigen::VectorXd vertex_spacing(const SurfaceMesh& surface);

/// Edge lengths wanted inside, at each surface vertex (m): `part` of the surface's
/// spacing there, less where the body is thin, so that four tetrahedra fit across it,
/// but never below half of that: thinner bodies would need nodes without end.
/// @param part  > 0
Eigen::VectorXd interior_size(const SurfaceMesh& surface, double part);

/// The body's diagonal at every vertex, with which a mesher adds no more nodes than it needs (m).
Eigen::VectorXd largest_size(const SurfaceMesh& surface);

}  // namespace testbed::meshing
