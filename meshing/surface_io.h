// Surface files in and out.
#pragma once

#include <filesystem>

#include "meshing/mesh.h"

namespace testbed {

/// Reads OBJ, OFF, PLY or STL in double precision. Vertex order is the file's; STL corners with equal bits are merged.
/// @throws std::runtime_error with file, line (text formats), value found and expected.
SurfaceMesh read_surface(const std::filesystem::path& file);

}  // namespace testbed
