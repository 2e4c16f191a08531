// Tetrahedra of a closed surface, by gmsh or, where it fails, by tetgen.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "meshing/base/child_process.h"
#include "meshing/base/mesh.h"

namespace testbed::meshing {

struct TetOptions {
  /// Longest edge wanted inside (m). Absent: edges as `size` says, longer far from the surface.
  std::optional<double> interior_size;
  Eigen::Matrix3Xd interior;  ///< points to keep as nodes n_surface, n_surface + 1, ... (3 x k)
  /// For each attempt, of the mesher's own computing (s); absent: time_limit(), of a cut surface 10 s at most.
  std::optional<double> time_limit{};
  /// Edge length wanted inside, at each surface vertex (m):
  /// interior_size() and the like. Empty: the surface's.
  Eigen::VectorXd size{};
  bool ends_when_stopped = false;                    ///< no mesher comes after one that was stopped
  bool is_tetgen_first = false;                      ///< as where gmsh fails on a surface
  std::filesystem::path workers = program_folder();  ///< where the meshers' programs lie
};

/// What a mesher may take for a surface of so many triangles and so many points to keep (s): more than any
/// took on the bodies that it filled.
double time_limit(Eigen::Index n_triangles, Eigen::Index n_points);

struct TetReport {
  std::string mesher;                 ///< attempt that succeeded
  std::vector<std::string> failures;  ///< attempts before it, each with the mesher's messages
};

/// Tetrahedra that fill the surface, whose vertices stay the first nodes, bit for bit, and whose triangles
/// are the boundary; they come in the order of their first nodes. Meshers run in a child process, one after the other until a result passes
/// check_tetrahedra: a crash is a failed attempt, and so is a run beyond the time limit (or ten times that
/// while others compute). A mesher that was stopped is not tried again with other settings.
/// @throws std::runtime_error with the places where the surface
/// crosses itself, or with every mesher's messages when none succeeds: OutOfTime where one was stopped.
TetMesh tetrahedralize(const SurfaceMesh& surface, const TetOptions& options = {},
                       TetReport* report = nullptr);

}  // namespace testbed::meshing
