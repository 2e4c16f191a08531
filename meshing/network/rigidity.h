// Whether a spring network is a solid or a mechanism.
#pragma once

#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Directions span space at a node when the least eigenvalue of the sum of n n^T over its springs is above
/// this; three orthogonal springs have 1.
constexpr double kLeastBracing = 0.05;

/// Nodes with fewer than 6 springs or whose springs do not span space.
std::vector<int> weak_nodes(const SpringNetwork& network);

/// Modes, beyond the 6 rigid ones of each connected part, that stretch no spring
/// to first order: eigenvalues of the network with unit stiffnesses below 1e-8,
/// counted by the signs of a sparse factorisation (CHOLMOD), not by counting springs.
/// @throws std::runtime_error when the factorisation fails.
int count_floppy_modes(const SpringNetwork& network);

}  // namespace testbed::meshing
