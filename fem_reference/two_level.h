// Conjugate gradients for a stiffness matrix. Internal to the library: it brings deal.II's headers.
#pragma once

#include <Eigen/Core>
#include <memory>

#include "fem_reference/space.h"

namespace testbed {

struct LinearReport {
  int iterations = 0;
  double residual = 0;  ///< relative to the right-hand side
  bool is_converged = false;
};

/// Solves fine.matrix x = b. Preconditioner: a sparse Cholesky factor of the degree-1 matrix; on degree 2 as
/// the coarse correction of a V-cycle between a SOR sweep and its transpose.
class TwoLevelSolver {
 public:
  /// @param coarse_space  null: the fine space is of degree 1 and has no other
  TwoLevelSolver(const Nodes& nodes, const Space& fine_space, const Space* coarse_space);
  ~TwoLevelSolver();

  /// Factorises the degree-1 matrix, shifted a little where rigid motions are free.
  /// @return false when it is not positive definite
  bool factorise(const SystemMatrix& degree_1, bool is_singular);

  /// @param rigid  free rigid motions over the degrees of freedom, orthonormal columns; kept out of x
  LinearReport solve(const SystemMatrix& fine, const Eigen::MatrixXd& rigid, const DealVector& b,
                     DealVector& x, double tolerance) const;

 private:
  void apply(const SystemMatrix& fine, DealVector& z, const DealVector& r) const;

  const Nodes& nodes_;
  const Space& fine_;
  const Space* coarse_;
  struct Factor;
  std::unique_ptr<Factor> factor_;
};

/// Takes the span of orthonormal columns out of v.
void project_out(const Eigen::MatrixXd& columns, DealVector& v);

}  // namespace testbed
