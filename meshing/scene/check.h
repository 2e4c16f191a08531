// What keys of a scene ask of each other.
#pragma once

#include <string>
#include <vector>

#include "meshing/scene/scene.h"
#include "meshing/scene/surface_problem.h"

namespace testbed::meshing {

/// Everything that neither solver can do, whatever models it has; programs call it once a scene is read.
/// @param file  of the scene, for the message
/// @throws std::runtime_error naming file, line of a key that is given, keys, values found and what is expected.
void check_scene(const Scene& scene, const std::string& file);

/// That no part of the surface lacks a support that others have, and that there is one where there are several parts, in
/// statics without obstacles to hold them. Parts that seams tie count as one.
/// @param problem  what the scene prescribes on the surface
/// @param file  of the scene, for the message
/// @throws std::runtime_error naming file, line and the box of the part.
void check_supports(const Scene& scene, const SurfaceMesh& surface, const SurfaceProblem& problem,
                    const std::string& file);

/// That the body moves in time or under load: something drives it, and supports do not hold the whole surface, as
/// it is cut by surface.across. Vibrations need no such drive.
/// @param file  of the scene, for the message
/// @throws std::runtime_error naming file, line and what is expected.
void check_motion(const Scene& scene, const SurfaceMesh& surface, const std::string& file);

/// What a user did probably not mean, though programs can solve it: units that make no sense or have no effect,
/// a surface of needles or one that crosses itself. A sentence each, with file and line or the command that
/// helps.
/// @param file  of the scene
std::vector<std::string> warnings_about(const Scene& scene, const SurfaceMesh& surface,
                                        const std::string& file);

/// The part that does not grow with gravity and loads, so that no factor on them gives a wanted strain, and
/// why; empty: none.
std::string unscalable_part(const Scene& scene);

}  // namespace testbed::meshing
