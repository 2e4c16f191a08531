// Conjugate gradients over several processes. Internal to the library: it brings deal.II's headers.
#pragma once

#include "fem_reference/solvers/two_level.h"

namespace testbed::fem {

/// Solves A x = b by conjugate gradients, preconditioned by
/// algebraic multigrid with rigid motions as near-null space.
/// @param part  this process' summand of A; the same unknowns are held in all
/// @param rigid  free rigid motions over the degrees of freedom, orthonormal columns; kept out of x
/// @param b  whole, as is the solution
LinearReport solve_distributed(const Nodes& nodes, const Space& space, const SystemMatrix& part,
                               const Eigen::MatrixXd& rigid, const Eigen::VectorXd& b, double tolerance);

}  // namespace testbed::fem
