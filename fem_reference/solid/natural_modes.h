// Natural frequencies of a solid.
#pragma once

#include "fem_reference/solid/dynamics.h"

namespace testbed::fem {

/// The lowest undamped modes, K x = w^2 M x.
struct Modes {
  Eigen::VectorXd frequency;  ///< Hz, ascending, of vibrations
  Eigen::MatrixXd shape;      ///< a column each, M-orthonormal (1/sqrt(kg))
  int n_rigid = 0;            ///< motions without energy besides
};

/// The n lowest vibrations by lowest_modes, fewer where there are no more. K may be singular, as that of a free
/// body, M must be positive definite; the unknowns `constrained` (ascending) stay where they are.
/// @param roots  what else is stiff, roots roots^T
/// @throws std::runtime_error when it does not converge.
Modes natural_modes(const Eigen::SparseMatrix<double>& K, const Eigen::SparseMatrix<double>& M,
                    const std::vector<int>& constrained, int n, const Eigen::MatrixXd& roots = {});

/// Of the dynamics of a solid, also of several processes: shapes have each one's part.
Modes natural_modes(const Dynamics& system, const ElasticSolid& solid, int n);

}  // namespace testbed::fem
