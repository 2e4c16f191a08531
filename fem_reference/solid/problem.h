// A scene on a mesh of tetrahedra, as the elastic solid takes it.
#pragma once

#include <string>

#include "fem_reference/solid/elasticity.h"
#include "meshing/base/mesh.h"
#include "meshing/scene/scene.h"

namespace testbed::fem {

/// The part of the scene that the reference does not model, and why; empty: none.
std::string unmodelled_part(const Scene& scene);

/// The scene's solid on `mesh` refined `scene.reference.refine` times, loads and supports assembled. Of several
/// processes the first has the mesh. Supports hold the surface's vertices in their region, and middles of boundary
/// edges whose both ends are constrained. The solid's coordinates are those along the axes of
/// frame_of(scene.supports), which are x, y and z unless supports hold along others.
/// @throws std::runtime_error when a region holds no node or triangle.
ElasticSolid assemble_scene(const Scene& scene, const SurfaceMesh& surface, const TetMesh& mesh);

/// That the solid of a scene begins outside of its obstacles.
/// @throws std::runtime_error as meshing::check_apart
void check_apart(const Scene& scene, const ElasticSolid& solid);

/// True when the displacement is proportional to the load factor, so that one solution serves all.
bool is_proportional(const Scene& scene);

}  // namespace testbed::fem
