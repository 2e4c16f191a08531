// Conjugate gradients over several processes. Internal to the library: it brings deal.II's headers.
#pragma once

#include "fem_reference/elements/space.h"
#include "fem_reference/solvers/two_level.h"

namespace testbed::fem {

/// Solves A x = b by conjugate gradients, preconditioned by
/// algebraic multigrid with rigid motions as near-null space.
/// @param part   this process' summand of A over ranks of nodes; the same unknowns are constrained in all
/// @param rank   of each node
/// @param rigid  free rigid motions (3 node + component), orthonormal columns; kept out of x
/// @param b      3 x n over nodes, whole, as is x
LinearReport solve_distributed(const Nodes& nodes, const Space& space, const meshing::BlockMatrix& part,
                               const std::vector<int>& rank, const Eigen::MatrixXd& rigid,
                               const Eigen::Matrix3Xd& b, double tolerance, Eigen::Matrix3Xd& x);

}  // namespace testbed::fem
