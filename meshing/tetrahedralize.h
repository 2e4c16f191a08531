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

}  // namespace testbed
