// Equilibrium at small strain: one linear solve, and none where a load step is proportional to the last.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "massspring/statics/quasi_static.h"

namespace testbed::massspring {

using Eigen::Matrix3Xd;

/// Slivers are beyond single precision, and those of single tetrahedra far stiffer than averages over patches.
/// Returns whether there is a factor to turn to.
bool QuasiStaticSolver::turn_to_factor() {
  if (is_exact_ || n_factor_entries(stiffness()) > kMostFactorEntries) return false;
  is_exact_ = true;
  solver_ = LinearSolver::of_factor("multigrid stood still");
  return true;
}

/// |f| of nodes where f is more than rounding leaves of the forces at displacements u: no solver does better than that
/// [Rigal & Gaches 1967]. It is told node by node, since beside flat tetrahedra it may be more than all loads.
double QuasiStaticSolver::norm_beyond_rounding(const Matrix3Xd& u, const Matrix3Xd& f) const {
  constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();  // of a sum of some ten products
  const Eigen::ArrayXd rounding = kRounding * u.colwise().norm().maxCoeff() * row_sums_.array();
  const Eigen::ArrayXd lengths = f.colwise().norm().transpose();
  return (lengths <= rounding).select(0, lengths).matrix().norm();  // what is not a number stays
}

/// Makes u orthogonal to the free rigid motions over the body's mass, wherever its nodes are dense.
void QuasiStaticSolver::remove_rigid_motion(Matrix3Xd& u) const {
  if (free_rigid_motions_.cols() == 0) return;
  const Eigen::VectorXd masses = model_.mass.transpose().replicate<3, 1>().reshaped();
  const Eigen::MatrixXd momenta = masses.asDiagonal() * free_rigid_motions_;
  const Eigen::MatrixXd inertia = momenta.transpose() * free_rigid_motions_;
  u.reshaped() -= free_rigid_motions_ * inertia.llt().solve(momenta.transpose() * u.reshaped());
}

StepReport QuasiStaticSolver::solve_linear(double load_factor, State& state) {
  constexpr int kMaxSolves = 5;  // later ones take what rounding left to the first
  // Displacements are kept on their own: beside the positions of a stiff body they would lose their digits.
  const LoadPath::Equilibrium& last = state.loading->path.last.back();
  Matrix3Xd u = last.x;
  if (last.load_factor > 0) u *= load_factor / last.load_factor;
  if (x_.size() == 0) x_ = model_.network.X;
  prescribe(forces_.constraints, Matrix3Xd::Zero(3, u.cols()), load_factor, 1, u);

  StepReport report;
  Matrix3Xd f, r, du;
  // Elastic forces at the end vanish where supports only move a body, or where it only shrinks.
  f = Matrix3Xd::Zero(3, u.cols());
  add_shrinkage_forces(model_, state, f);
  double scale = f.norm();
  const auto measure = [&] {
    f.setZero();
    add_linear_forces(model_, state, u, f);
    r = f + load_factor * forces_.load;
    project(r);
    const double left = norm_beyond_rounding(u, r);
    scale = std::max({scale, load_factor * forces_.load.norm() + norm_beyond_rounding(u, f), left});
    report.residual = scale > 0 ? left / scale : 0;
  };
  const State rest = initial_state(model_);
  const LinearSystem A = system(rest);
  const auto solve = [&](bool is_last_try) {
    measure();
    bool is_still = false;
    for (int n = 0; n < kMaxSolves && report.residual > tolerance_ && (is_last_try || !is_still); ++n) {
      const double tolerance = tolerance_ * scale / r.norm() / 2;
      du = Matrix3Xd::Zero(3, u.cols());
      const SolveReport linear = solver_.solve(A, r, du, tolerance);
      report.linear_iterations += linear.iterations;
      is_still = !linear.is_converged;
      u += du;
      ++report.newton_iterations;
      measure();
    }
  };
  const Matrix3Xd first = u;
  const double first_scale = scale;
  solve(false);
  if (!(report.residual <= tolerance_) && !has_coarser_) {
    if (turn_to_factor()) {
      u = first;
      scale = first_scale;
    }
    solve(true);
  }
  if (!std::isfinite(report.residual)) {  // the state stays what it was
    report.status = Status::Diverged;
    return report;
  }
  remove_rigid_motion(u);
  displace(u, state);
  state.loading->path.last = {{load_factor, u}};
  if (report.residual > tolerance_) {
    report.status = Status::NotConverged;
    report.reason = "the linear system's conjugate gradients stand still";
  }
  return report;
}

}  // namespace testbed::massspring
