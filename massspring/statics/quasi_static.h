// Equilibrium under dead loads, without integrating time.
#pragma once

#include <memory>

#include "massspring/model/model.h"
#include "meshing/algebra/cholesky.h"

namespace testbed::massspring {

/// Newton's method on the potential energy with its Hessian kept positive semidefinite and a backtracking
/// line search. Linear systems by conjugate gradients, preconditioned by the Cholesky factor of the stiffness
/// at rest, renewed where that has become a poor guide.
///
/// Motions that cost no energy at rest are kept out of the solution: rigid ones that the supports leave free,
/// and those of a network that is a mechanism, as the paper's is [massspring/README.md, section 1].
/// Nothing would stop the latter; the share of the load on them is reported.
class QuasiStaticSolver {
 public:
  /// @param tolerance  of the balance of forces, relative to the largest met on the way, or else to rounding
  /// @throws std::runtime_error when the supports leave rigid motions free that the loads would drive: names
  /// force and torque.
  QuasiStaticSolver(const MassSpringModel& model, const Forces& forces,
                    double tolerance = TimeOptions().residual);

  /// Moves `state` to equilibrium at `load_factor` times the full loads and prescribed displacements. Beyond
  /// a limit point, where the energy has no minimum, ends once the body has run away by its own size. Starts
  /// from where the last two equilibria point to, if that is nearer to balance than `state`. A linear model
  /// [small_strain.h], under dead loads alone, takes one linear solve from what the last equilibrium is in
  /// proportion to.
  StepReport solve(double load_factor, State& state);

  int n_free_rigid_motions() const { return n_free_rigid_motions_; }
  /// Motions besides the rigid ones that cost no energy at rest.
  int n_floppy_motions() const { return static_cast<int>(held_motions_.cols()) - n_free_rigid_motions_; }
  /// |part of the load on floppy motions| / |load|: what the solution does not carry.
  double floppy_load_share() const { return floppy_load_share_; }

 private:
  struct Equilibrium {
    double load_factor;
    Eigen::Matrix3Xd x;
  };

  StepReport solve_linear(double load_factor, State& state);
  void predict(double load_factor, State& state) const;
  void factorise(BlockMatrix P);
  Eigen::Matrix3Xd residual(const State& state, double load_factor) const;
  void project(Eigen::Matrix3Xd& y) const;

  const MassSpringModel& model_;
  const Forces& forces_;
  double tolerance_;
  Eigen::MatrixXd held_motions_;  ///< orthonormal basis of the motions without energy, 3n x m
  int n_free_rigid_motions_ = 0;
  double floppy_load_share_ = 0;
  BlockMatrix K_;
  double largest_stiffness_;  ///< on the diagonal of the simple stiffness at rest (N/m)
  std::unique_ptr<BlockCholesky> preconditioner_;
  Equilibrium last_, before_last_;
  Eigen::Matrix3Xd u_;  ///< of a linear model: displacement at the last equilibrium (m)
};

/// Motions other than rigid ones that the constraints leave free and that cost no energy at rest.
int n_floppy_motions(const MassSpringModel& model, const std::vector<Constraint>& constraints);

}  // namespace testbed::massspring
