// The linear systems of implicit steps.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "massspring/cholesky.h"
#include "massspring/conjugate_gradients.h"
#include "meshing/scene.h"

namespace testbed {

/// A symmetric positive definite system by what a solver may ask of it.
struct LinearSystem {
  std::function<void(const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y)> product;  ///< y = A p, 3 x n
  std::function<void(std::vector<Eigen::Matrix3d>&)> diagonal;                  ///< diagonal blocks of A
  /// A, or what is near it (without a rank-one part, say): only to be factorised as preconditioner.
  std::function<const BlockMatrix&()> matrix;
};

/// Conjugate gradients, preconditioned by the inverse diagonal blocks until these need too many iterations,
/// then, where its fill is affordable, by a Cholesky factor that is kept from system to system while it
/// serves. Or, to compare, bi-conjugate gradients with the inverse diagonal blocks.
class LinearSolver {
 public:
  explicit LinearSolver(Krylov krylov = Krylov::Cg) : krylov_(krylov) {}

  /// @param x  the first guess, then the solution
  SolveReport solve(const LinearSystem& A, const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance);

  /// The preconditioner in use and why.
  const std::string& choice() const { return choice_; }

 private:
  SolveReport solve_by_factor(const LinearSystem& A, const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x,
                              double tolerance);

  Krylov krylov_;
  std::unique_ptr<BlockCholesky> factor_;
  std::vector<Eigen::Matrix3d> diagonal_;
  std::string choice_ = "block Jacobi: no system was hard so far";
};

}  // namespace testbed
