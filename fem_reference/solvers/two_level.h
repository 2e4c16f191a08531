// Conjugate gradients for a stiffness matrix. Internal to the library: it brings deal.II's headers.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>

#include "fem_reference/elements/space.h"

namespace testbed::fem {

struct LinearReport {
  Eigen::VectorXd x;
  std::string solver;
  int iterations = 0;
  double residual = 0;  ///< relative to the right-hand side
  bool is_converged = false;
  bool is_definite = true;  ///< false where a Cholesky factor does not exist
};

/// Conjugate gradients, preconditioned on degree 1 by a sparse Cholesky factor, of large systems by algebraic
/// multigrid with rigid motions as near-null space; on degree 2 by two levels, Gauss-Seidel sweeps and a
/// correction of degree 1 by the same. Where that is slow (slivers), by a Cholesky factor of the whole
/// matrix. Factors are kept from one solve to the next while they serve.
class TwoLevelSolver {
 public:
  /// @param coarse_space  null: the fine space is of degree 1 and has no other
  TwoLevelSolver(const Nodes& nodes, const Space& fine_space, const Space* coarse_space);
  ~TwoLevelSolver();

  /// Drops what was made of the matrices before.
  void forget();

  /// Solves fine x = b.
  /// @param degree_1  the matrix of degree 1: `fine` itself on degree 1
  /// @param rigid  free rigid motions over the degrees of freedom, orthonormal columns; kept out of x
  LinearReport solve(const SystemMatrix& fine, const SystemMatrix& degree_1, const Eigen::MatrixXd& rigid,
                     const Eigen::VectorXd& b, double tolerance);

 private:
  struct Levels;
  std::unique_ptr<Levels> levels_;
};

}  // namespace testbed::fem
