// Equilibrium under dead loads, without integrating time.
#pragma once

#include <memory>
#include <optional>

#include "massspring/model/model.h"
#include "meshing/algebra/cholesky.h"
#include "meshing/algebra/linear_solver.h"
#include "meshing/algebra/load_path.h"

namespace testbed::massspring {

/// Newton's method on the potential energy with a backtracking line search, along a path of load steps that
/// adapt. Its matrix is the Hessian, with negative eigenvalues taken away where conjugate gradients meet any;
/// it stays while residuals fall fast. Linear systems in single precision, preconditioned by the stiffness of
/// the single tetrahedra, the residual in double.
///
/// Motions that cost no energy at rest are kept out of the solution: rigid ones that the supports leave free,
/// and those of a network that is a mechanism, as the paper's is [massspring/README.md, section 1].
/// Nothing would stop the latter; the share of the load on them is reported. Where obstacles act on the surface,
/// they may hold what supports leave free.
class QuasiStaticSolver {
 public:
  /// @param tolerance  of the residual over the sum of load and internal forces, constrained components included,
  /// the largest met on the way, or else over rounding
  /// @throws std::runtime_error when the supports leave rigid motions free that the loads would drive, and no
  /// obstacle may hold them: names force and torque.
  QuasiStaticSolver(const MassSpringModel& model, const Forces& forces,
                    double tolerance = TimeOptions().residual);

  /// Moves `state` to equilibrium at `load_factor` times the full loads and prescribed displacements, in
  /// shorter steps where one finds none. On these rest lengths and target volume change evenly. Beyond a
  /// limit point, where the energy has no minimum, ends at the last equilibrium, once the body has run away
  /// by its own size. Starts from where the last equilibria point to, if the energy is lower there. A linear
  /// model [small_strain.h], under dead loads alone, takes one linear solve from what the last equilibrium is
  /// in proportion to; where that stands still, another by a factor of the stiffness in double precision. The last equilibria are those in the state; preconditioners are kept from step to step and
  /// change a step within its tolerance.
  StepReport solve(double load_factor, State& state);

  /// Makes of a state at rest one whose last equilibrium is u (3 x n, m), under the full loads.
  void start_at(const Eigen::Matrix3Xd& u, State& state) const;

  /// Solves linear systems from that of a solver on edges twice as long, which outlives it and has solved its own. What
  /// stands still so ends: a factor would take many times as long as the coarser equilibrium.
  void set_coarser(const Eigen::Matrix2Xi& between, QuasiStaticSolver& coarser);

  /// How linear systems are solved, and why.
  const std::string& solver_choice() const { return solver_.choice(); }

  int n_free_rigid_motions() const { return static_cast<int>(free_rigid_motions_.cols()); }
  /// Motions besides the rigid ones that cost no energy at rest.
  int n_floppy_motions() const {
    return static_cast<int>(zero_energy_motions_.cols() - free_rigid_motions_.cols());
  }
  /// |part of the load on floppy motions| / |load|: what the solution does not carry.
  double floppy_load_share() const { return floppy_load_share_; }

 private:
  StepReport solve_linear(double load_factor, State& state);
  void find_balance(double load_factor, const Eigen::Matrix3Xd& last_x, State& state, StepReport& report);
  void displace(const Eigen::Matrix3Xd& u, State& state) const;
  void set_stiffness(const State& state, double load_factor, Curvature curvature);
  LinearSystem system(const State& state);
  BlockMatrix stiffness() const;
  void product(const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) const;
  double product(const PaddedField& p, PaddedField& y);
  const BlockMatrix& preconditioning_matrix(const State& state);
  bool turn_to_factor();
  Eigen::Matrix3Xd residual(const State& state, double load_factor, double& size) const;
  void project(Eigen::Matrix3Xd& y) const;
  void project(PaddedField& y) const;
  double norm_beyond_rounding(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& f) const;
  void remove_rigid_motion(Eigen::Matrix3Xd& u) const;

  const MassSpringModel& model_;
  const Forces& forces_;
  double tolerance_;
  Eigen::MatrixXd free_rigid_motions_;          ///< orthonormal, 3n x m
  Eigen::MatrixXd zero_energy_motions_;         ///< orthonormal basis of the motions without energy, 3n x m
  Eigen::MatrixXf single_zero_energy_motions_;  ///< as padded fields
  double floppy_load_share_ = 0;
  double largest_stiffness_;  ///< at rest (N/m): a sum of a row's if linear, else an entry on the diagonal
  Eigen::VectorXd row_sums_;  ///< of a linear model, per node (N/m)

  // The matrix at hand: K and what acts on the surface, at x.
  BlockMatrix K_;                          ///< empty for a linear model, which has its own
  std::optional<SingleStiffness> single_;  ///< of K_, or of a linear model once it is asked for
  SurfaceHessian surface_;
  std::vector<PaddedField> single_roots_;
  Eigen::Matrix3Xd x_;

  BlockMatrix P_;          ///< of which preconditioners are made
  bool is_exact_ = false;  ///< of the stiffness itself
  bool has_coarser_ = false;
  LinearSolver solver_;
  LoadHistory rest_;  ///< of a state at rest
};

/// Whether the constraints leave motions free, other than rigid ones, that cost no energy at rest. None where a factor
/// of the stiffness, which tells it if no single node does, would have more entries than that.
std::optional<bool> has_floppy_motions(const MassSpringModel& model,
                                       const std::vector<Constraint>& constraints,
                                       double most_factor_entries = kMostFactorEntries);

}  // namespace testbed::massspring
