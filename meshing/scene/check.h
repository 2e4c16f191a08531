// What keys of a scene ask of each other.
#pragma once

#include <string>

#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// Everything that neither solver can do, whatever models it has; programs call it once a scene is read.
/// @param file  of the scene, for the message
/// @throws std::runtime_error naming file, keys, values found and what is expected.
void check_scene(const Scene& scene, const std::string& file);

/// Parts of the scene that the reference does not model; empty: none.
std::string unmodelled_part(const Scene& scene);

}  // namespace testbed::meshing
