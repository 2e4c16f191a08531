// Surface files in and out.
#pragma once

#include <filesystem>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

struct ReadReport {
  int n_merged = 0;  ///< vertices dropped because an earlier one has the same position (texture seams, STL)
  std::vector<Eigen::Vector3d> points;     ///< as they stand in the file; of VTK files those of polygons
  std::vector<Eigen::Vector3i> triangles;  ///< of these points, in the order of the surface's
  std::vector<int> vertices;               ///< of the surface, for each point
};

/// Reads OBJ, OFF, PLY, STL, VTP or VTU in double precision. Vertices keep the file's order; those at equal
/// positions are merged into the first. Polygons are cut into triangles.
/// VTP and VTU are read by a process of its own (vtk_worker), whose time and memory are limited by the file's size.
/// @throws std::runtime_error with file, line (text formats), value found and expected.
SurfaceMesh read_surface(const std::filesystem::path& file, ReadReport* report = nullptr);

/// Writes OBJ or OFF, by the file's extension, with all digits of a double.
/// @throws std::runtime_error when the extension is another or the file cannot be written.
void write_surface(const std::filesystem::path& file, const SurfaceMesh& surface);

}  // namespace testbed::meshing
