// Measures and checks of tetrahedra.
#pragma once

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// The surface's vertices must be the mesh's first nodes bit for bit, and its triangles the boundary faces.
/// Every node must be a corner, every volume positive, and they must add up to the surface's.
/// @throws std::runtime_error otherwise.
void check_tetrahedra(const TetMesh& mesh, const SurfaceMesh& surface);

struct TetQuality {
  double min_dihedral;      ///< degrees; 70.5 in a regular tetrahedron
  double min_radius_ratio;  ///< three times inscribed over circumscribed radius; 1 in a regular one
  double mean_radius_ratio;
  int n_slivers;  ///< 6 sqrt(2) V / (longest edge)^3 < 0.05; 1 in a regular one
};
TetQuality tet_quality(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T);

}  // namespace testbed::meshing
