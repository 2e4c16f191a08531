// The spring network that a scene asks for.
#pragma once

#include "meshing/mesh.h"
#include "meshing/scene.h"
#include "meshing/tetrahedralize.h"

namespace testbed {

/// Internal nodes sampled or made by the mesher, springs joined as the scene's network table says, and, where
/// wanted, tetrahedra on the same nodes. Where sampled nodes get tetrahedra, those that the mesher must add
/// join the network.
/// @throws std::runtime_error for a name that is not known or options out of range, or when no mesher fills
/// the surface.
SpringNetwork build_network(const SurfaceMesh& surface, const NetworkOptions& options, bool needs_tetrahedra,
                            TetReport* report = nullptr);

}  // namespace testbed
