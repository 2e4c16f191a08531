// The linear systems of implicit steps.
#pragma once

#include <memory>
#include <string>

#include "massspring/algebra/cholesky.h"
#include "massspring/algebra/conjugate_gradients.h"
#include "massspring/algebra/multigrid.h"
#include "meshing/base/choices.h"

namespace testbed::massspring {

/// Conjugate gradients, preconditioned by the inverse diagonal blocks until these need too many iterations,
/// then by a Cholesky factor or, where its fill is not affordable, multigrid, which are kept from system to
/// system while they serve, the factor only while it costs less than it saves; from 500 nodes on in single
/// precision, refined by residuals in double, unless that has once been too little [Wilkinson 1963]. Or, to
/// compare, bi-conjugate gradients with the inverse diagonal blocks.
class LinearSolver {
 public:
  explicit LinearSolver(Krylov krylov = Krylov::Cg) : krylov_(krylov) {}

  /// @param x  the first guess, then the solution
  SolveReport solve(const LinearSystem& A, const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance);

  /// The preconditioner in use and why.
  const std::string& choice() const { return choice_; }

 private:
  using Matrix3Xd = Eigen::Matrix3Xd;
  template <class Precondition>
  SolveReport refine(const LinearSystem& A, const Precondition& precondition, const Matrix3Xd& b,
                     Matrix3Xd& x, double tolerance, int max_iterations);
  SolveReport solve_by_factor(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance);
  SolveReport solve_by_multigrid(const LinearSystem& A, const Matrix3Xd& b, Matrix3Xd& x, double tolerance);

  Krylov krylov_;
  std::unique_ptr<BlockCholesky> factor_;
  std::unique_ptr<Multigrid> multigrid_;
  bool is_multigrid_chosen_ = false;
  int patience_ = 500;        ///< iterations with block Jacobi beyond which a factor is tried
  int first_iterations_ = 0;  ///< of multigrid when it was made
  std::vector<Eigen::Matrix3d> inverse_;
  SymmetricBlocks rounded_inverse_;
  bool is_single_enough_ = true;  ///< single precision led to the tolerance so far
  std::string choice_ = "block Jacobi: no system was hard so far";
};

}  // namespace testbed::massspring
