// What tetrahedralize and its child processes tell each other, and what the latter do. One child per mesher:
// gmsh holds a tetgen of its own, whose symbols clash with the library's.
#pragma once

#include <filesystem>
#include <string>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

struct TetTask {
  SurfaceMesh surface;
  Eigen::Matrix3Xd interior;  ///< points to keep
  Eigen::VectorXd size;       ///< edge length wanted inside, at each surface vertex (m)
  double longest = 0;         ///< anywhere (m); 0 for no limit
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

/// The mesher of the worker that links it: gmsh (with its algorithm
/// number and smallest angle between facets, in degrees) or tetgen.
/// @throws whatever the mesher throws, std::string among it.
TetNodes mesh_task(const TetTask& task, int algorithm, double angle_tolerance);

}  // namespace testbed::meshing
