// What tetrahedralize and its child process, tet_worker, tell each other, and the meshers in the latter.
#pragma once

#include <filesystem>
#include <string>

#include "meshing/mesh.h"

namespace testbed {

struct TetTask {
  SurfaceMesh surface;
  Eigen::Matrix3Xd interior;  ///< points to keep
  double interior_size = 0;   ///< m; 0 for none
};

/// Nodes in the order surface, interior, added; verified by the receiver.
struct TetNodes {
  Eigen::Matrix3Xd X;
  Eigen::Matrix4Xi T;
};

void write_task(const std::filesystem::path& file, const TetTask& task);
TetTask read_task(const std::filesystem::path& file);
void write_nodes(const std::filesystem::path& file, const TetNodes& nodes);
TetNodes read_nodes(const std::filesystem::path& file);

/// @throws whatever the mesher throws, std::string among it.
TetNodes mesh_by_gmsh(const TetTask& task, int algorithm, double angle_tolerance);
TetNodes mesh_by_tetgen(const TetTask& task);

}  // namespace testbed
