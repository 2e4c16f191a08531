// Tetrahedra of a closed surface, by gmsh or, where it fails, by tetgen.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

struct TetOptions {
  /// Longest edge wanted inside (m). Absent: edges as `size` says, longer far from the surface.
  std::optional<double> interior_size;
  Eigen::Matrix3Xd interior;  ///< points to keep as nodes n_surface, n_surface + 1, ... (3 x k)
  double time_limit = 300;    ///< for each attempt (s)
  /// Edge length wanted inside, at each surface vertex (m):
  /// interior_size() and the like. Empty: the surface's.
  Eigen::VectorXd size{};
};

struct TetReport {
  std::string mesher;                 ///< attempt that succeeded
  std::vector<std::string> failures;  ///< attempts before it, each with the mesher's messages
};

/// Tetrahedra that fill the surface, whose vertices stay the first nodes, bit for bit, and whose triangles
/// are the boundary. Meshers run in a child process, one after the other until a result passes
/// check_tetrahedra: a crash or an endless run is a failed attempt.
/// @throws std::runtime_error with the places where the surface
/// crosses itself, or with every mesher's messages when none succeeds.
TetMesh tetrahedralize(const SurfaceMesh& surface, const TetOptions& options = {},
                       TetReport* report = nullptr);

}  // namespace testbed::meshing
