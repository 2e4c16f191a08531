// Equilibrium under dead loads, without integrating time.
#pragma once

#include <memory>

#include "massspring/cholesky.h"
#include "massspring/model.h"

namespace testbed {

/// Newton's method on the potential energy with its Hessian kept positive semidefinite, backtracking line
/// search, and a shift of the Hessian [Levenberg 1944] that grows only where the network is a mechanism.
/// Linear systems by conjugate gradients, preconditioned by the Cholesky factor of the stiffness at rest (of
/// single tetrahedra, which is sparser, where springs are coupled).
class QuasiStaticSolver {
 public:
  /// @throws std::runtime_error when the supports leave rigid motions free that the loads would drive: names
  /// force and torque.
  QuasiStaticSolver(const MassSpringModel& model, const Forces& forces);

  /// Moves `state` to equilibrium at `load_factor` times the full loads and prescribed displacements.
  StepReport solve(double load_factor, State& state);

  int n_free_rigid_motions() const { return static_cast<int>(rigid_motions_.cols()); }

 private:
  void factorise(const State& state, double shift);
  Eigen::Matrix3Xd residual(const State& state, double load_factor) const;
  void project(Eigen::Matrix3Xd& y) const;
  double potential(const State& state, double load_factor) const;

  const MassSpringModel& model_;
  const Forces& forces_;
  Eigen::MatrixXd rigid_motions_;  ///< orthonormal basis of those the supports leave free, 3n x m
  BlockMatrix K_;
  std::unique_ptr<BlockCholesky> preconditioner_;
  double stiffness_scale_ = 0;  ///< largest diagonal entry at rest (N/m)
};

}  // namespace testbed
