// Surface files in and out.
#pragma once

#include <filesystem>

#include "meshing/mesh.h"

namespace testbed {

/// Reads OBJ, OFF, PLY (ASCII and binary) or STL (ASCII and binary) in double precision; polygons are cut
/// into fans. Vertex order is the file's; corners of an STL with equal bits are merged. The readers are ours
/// because VTK's return single precision, split vertices at OBJ normals and know no OFF.
/// @throws std::runtime_error with file, line (text formats), value found and expected.
SurfaceMesh read_surface(const std::filesystem::path& file);

/// Writes OFF with 17 digits, under a temporary name until complete.
void write_off(const std::filesystem::path& file, const SurfaceMesh& surface);

}  // namespace testbed
