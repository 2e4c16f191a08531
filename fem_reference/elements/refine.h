// Uniform refinement of straight tetrahedra.
#pragma once

#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::fem {

/// Splits every tetrahedron into eight [Bey 1995] and every boundary triangle into four, children of triangle
/// f at 4 f ... 4 f + 3. Old nodes keep their numbers (n_surface too); the same polyhedron is filled.
TetMesh refine(const TetMesh& mesh);

}  // namespace testbed::fem
