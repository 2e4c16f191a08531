// Natural frequencies of small undamped motions about rest.
#pragma once

#include "massspring/model.h"

namespace testbed {

struct NaturalFrequencies {
  Eigen::VectorXd
      at_nodes;  ///< Hz, ascending, 0 for rigid motions, of K x = (2 pi f)^2 M x, M the nodes' masses
  Eigen::VectorXd spread;  ///< of the same motions with the mass spread over the tetrahedra, by Rayleigh's
                           ///< quotient; empty where there are none
};

/// The n lowest on the directions that are free, by Lanczos iteration on (K + s M)^-1, s > 0 small.
/// @throws std::runtime_error when that has no Cholesky factor or the iteration does not converge.
NaturalFrequencies natural_frequencies(const MassSpringModel& model,
                                       const std::vector<Constraint>& constraints, int n);

}  // namespace testbed
