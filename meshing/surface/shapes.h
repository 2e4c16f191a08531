// The project's own test surfaces.
#pragma once

#include <string>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Names accepted by make_shape: ball, hollow_ball, torus, bar, handle, head.
const std::vector<std::string>& shape_names();

/// A closed surface of about `n_vertices` vertices: the nearest number that the shape can have.
/// Its bounding box is scaled to `size` (m) where a component is positive.
/// @throws std::runtime_error for an unknown name, a number too small for the shape, or more than a million.
SurfaceMesh make_shape(const std::string& name, int n_vertices, const Eigen::Vector3d& size = {0, 0, 0});

}  // namespace testbed::meshing
