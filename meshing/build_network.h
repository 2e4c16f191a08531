// The spring network that a scene asks for.
#pragma once

#include "meshing/mesh.h"
#include "meshing/scene.h"

namespace testbed {

/// Samples and joins nodes as the scene's network table says.
/// @throws std::runtime_error for a name that is not known or options out of range.
SpringNetwork build_network(const SurfaceMesh& surface, const NetworkOptions& options);

}  // namespace testbed
