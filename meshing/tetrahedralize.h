// Tetrahedra of a closed surface, by gmsh.
#pragma once

#include <optional>

#include "meshing/mesh.h"

namespace testbed {

struct TetOptions {
  std::optional<double> interior_size;  ///< edge length wanted inside (m); from the surface's edges if absent
  Eigen::Matrix3Xd interior;  ///< points to keep as nodes n_surface, n_surface + 1, ... (3 x k, may be empty)
};

/// Tetrahedra that fill the surface, whose vertices stay the first nodes, bit for bit, and whose triangles
/// are the boundary.
/// @throws std::runtime_error with the mesher's own message when none can be made; verified before it is
/// returned.
TetMesh tetrahedralize(const SurfaceMesh& surface, const TetOptions& options = {});

/// Signed volume (m3): positive when the corners 1, 2, 3 turn counter-clockwise seen from against corner 0.
double tet_volume(const Eigen::Matrix3Xd& X, const Eigen::Vector4i& tet);

/// @throws std::runtime_error unless the surface's vertices are the mesh's first nodes bit for bit, every
/// volume is positive, they add up to the surface's, and the boundary faces are its triangles.
void check_tetrahedra(const TetMesh& mesh, const SurfaceMesh& surface);

}  // namespace testbed
