// The connected parts of a surface and how they lie inside each other.
#pragma once

#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// A connected part of a closed surface.
struct Shell {
  std::vector<int> triangles;
  double volume = 0;  ///< signed (m3): negative for a cavity's wall
  int parent = -1;    ///< innermost shell around it, -1 for none
  int depth = 0;      ///< number of shells around it
};

/// Shells in the order of their first triangles. The surface must be closed and its shells must not cross.
std::vector<Shell> shells_of(const SurfaceMesh& surface);

/// How often the surface winds around x: 1 inside, 0 outside,
/// by the sum of solid angles [Van Oosterom & Strackee 1983].
double winding_number(const Eigen::Vector3d& x, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

}  // namespace testbed::meshing
