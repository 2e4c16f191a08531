// Springs coupled within tetrahedra, and blended with node-averaged strain.
#pragma once

#include <Eigen/Core>

namespace testbed {

/// Springs on the six edges of every tetrahedron, coupled so that they stand for an isotropic solid.
struct TetSprings {};

}  // namespace testbed
