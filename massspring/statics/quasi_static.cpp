#include "massspring/statics/quasi_static.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "meshing/algebra/conjugate_gradients.h"
#include "meshing/algebra/newton.h"
#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/random.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& A) {
  return Eigen::HouseholderQR<Eigen::MatrixXd>(A).householderQ() *
         Eigen::MatrixXd::Identity(A.rows(), A.cols());
}

/// Orthonormal basis of the rigid motions of X that leave every constrained direction at rest, 3n x m, m
/// <= 6.
Eigen::MatrixXd free_rigid_motions(const Matrix3Xd& X, const std::vector<Constraint>& constraints) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  const double size = (X.colwise() - centre).colwise().norm().maxCoeff();
  Eigen::MatrixXd R(X.size(), 6);
  for (int i = 0; i < X.cols(); ++i) R.middleRows<3>(3 * i) = rigid_motions_at((X.col(i) - centre) / size);
  Eigen::Matrix<double, 6, 6> held = Eigen::Matrix<double, 6, 6>::Zero();
  for (const Constraint& c : constraints) {
    const Eigen::Matrix<double, 3, 6> moved =
        (Eigen::Matrix3d::Identity() - c.S) * R.middleRows<3>(3 * c.node);
    held += moved.transpose() * moved;
  }
  constexpr double kZero = 1e-10;  // squared sines of the angles at which supports hold a motion
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(held);
  const int m = static_cast<int>((eigen.eigenvalues().array() < kZero).count());
  return m == 0 ? Eigen::MatrixXd(X.size(), 0) : orthonormal(R * eigen.eigenvectors().leftCols(m));
}

/// Orthonormal basis of the motions on which K does no work, 3n x m, by subspace iteration with K's shifted
/// factor.
/// @param scale  largest diagonal entry of K
Eigen::MatrixXd zero_energy_motions(const BlockMatrix& K, const BlockCholesky& factor, double scale) {
  constexpr double kZero = 1e-7;  // of the largest stiffness: soft motions of sound networks lie above
  constexpr int kIterations = 4;
  Random random(1);
  const int n = K.rows();
  for (int m = std::min(64, 3 * n);; m = std::min(2 * m, 3 * n)) {
    Eigen::MatrixXd Q(3 * n, m), KQ(3 * n, m);
    for (double& q : Q.reshaped()) q = random.uniform() - 0.5;
    Matrix3Xd y;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      for (auto q : Q.colwise()) {
        factor.solve(q.reshaped(3, n), y);
        q = y.reshaped();
      }
      Q = orthonormal(Q);
    }
    for (int k = 0; k < m; ++k) {
      multiply(K, Q.col(k).reshaped(3, n), y);
      KQ.col(k) = y.reshaped();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> ritz(Q.transpose() * KQ);
    const int n_zero = static_cast<int>((ritz.eigenvalues().array() < kZero * scale).count());
    if (n_zero < m || m == 3 * n) return Q * ritz.eigenvectors().leftCols(n_zero);
  }
}

double largest_diagonal(const BlockMatrix& A) {
  double largest = 0;
  for (int i = 0; i < A.rows(); ++i) largest = std::max(largest, A.block[A.find(i, i)].diagonal().maxCoeff());
  return largest;
}

/// Stiffness of the model, or where springs are coupled of its single tetrahedra alone, which is sparser.
BlockMatrix simple_stiffness(const MassSpringModel& model, const State& state) {
  if (!model.tet_springs) {
    BlockMatrix K = stiffness_pattern(model);
    add_stiffness(model, state, K);
    return K;
  }
  const TetSprings simple =
      couple_springs(model.network.X, model.network.T, lame_of(model.material), kEdgeCoupled);
  BlockMatrix K = make_block_matrix(static_cast<int>(state.x.cols()), pairs_of(simple));
  add_hessian(simple, state.x, K);
  return K;
}

std::unique_ptr<BlockCholesky> shifted_factor(BlockMatrix P, const std::vector<Constraint>& constraints) {
  constexpr double kShift = 1e-8;  // so that a factor exists where motions cost no energy
  const double scale = largest_diagonal(P);
  for (int i = 0; i < P.rows(); ++i) P.block[P.find(i, i)].diagonal().array() += kShift * scale;
  filter(constraints, P);
  auto factor = std::make_unique<BlockCholesky>(P);
  if (!factor->is_ok())
    throw std::runtime_error("the stiffness has no Cholesky factor, expected a positive definite model");
  return factor;
}

}  // namespace

int n_floppy_motions(const MassSpringModel& model, const std::vector<Constraint>& constraints) {
  if (model.tet_springs) return 0;  // rigid motions are all that tetrahedra leave free
  BlockMatrix K = simple_stiffness(model, initial_state(model));
  const auto factor = shifted_factor(K, constraints);
  filter(constraints, K);
  const auto n_free = zero_energy_motions(K, *factor, largest_diagonal(K)).cols();
  return static_cast<int>(n_free - free_rigid_motions(model.network.X, constraints).cols());
}

QuasiStaticSolver::QuasiStaticSolver(const MassSpringModel& model, const Forces& forces, double tolerance)
    : model_(model),
      forces_(forces),
      tolerance_(tolerance),
      held_motions_(free_rigid_motions(model.network.X, forces.constraints)) {
  n_free_rigid_motions_ = static_cast<int>(held_motions_.cols());
  const Eigen::Map<const Eigen::VectorXd> load(forces.load.data(), forces.load.size());
  constexpr double kBalanced = 1e-8;  // rounding of a sum over many nodes
  if ((held_motions_.transpose() * load).norm() > kBalanced * load.norm()) {
    const Eigen::Vector3d force = forces.load.rowwise().sum(), centre = model.network.X.rowwise().mean();
    Eigen::Vector3d torque = Eigen::Vector3d::Zero();
    for (int i = 0; i < forces.load.cols(); ++i)
      torque += (model.network.X.col(i) - centre).cross(forces.load.col(i));
    std::ostringstream what;
    what << "the supports leave " << n_free_rigid_motions_
         << " rigid motions free and the loads drive them: net force (" << force.transpose()
         << ") N, net torque (" << torque.transpose()
         << ") N m about the centre; expected more supports or balanced loads";
    throw std::runtime_error(what.str());
  }
  K_ = stiffness_pattern(model);
  const State rest = initial_state(model);
  last_ = before_last_ = {0, rest.x};
  BlockMatrix P = simple_stiffness(model, rest);
  largest_stiffness_ = largest_diagonal(P);
  factorise(P);
  if (model.tet_springs) return;  // rigid motions are all that tetrahedra leave free
  filter(forces.constraints, P);
  held_motions_ = zero_energy_motions(P, *preconditioner_, largest_diagonal(P));
  const double load_norm = load.norm();
  if (load_norm > 0) floppy_load_share_ = (held_motions_.transpose() * load).norm() / load_norm;
}

void QuasiStaticSolver::factorise(BlockMatrix P) {
  preconditioner_ = shifted_factor(std::move(P), forces_.constraints);
}

void QuasiStaticSolver::project(Matrix3Xd& y) const {
  filter(forces_.constraints, y);
  if (held_motions_.cols() == 0) return;
  Eigen::Map<Eigen::VectorXd> flat(y.data(), y.size());
  flat -= held_motions_ * (held_motions_.transpose() * flat).eval();
}

Matrix3Xd QuasiStaticSolver::residual(const State& state, double load_factor) const {
  Matrix3Xd r;
  undamped_forces(model_, forces_, state, r, load_factor);
  project(r);
  return r;
}

void QuasiStaticSolver::predict(double load_factor, State& state) const {
  prescribe(forces_.constraints, model_.network.X, load_factor, 1, state.x);
  const double way = last_.load_factor - before_last_.load_factor;
  if (way == 0) return;
  State ahead = state;
  ahead.x = last_.x + (load_factor - last_.load_factor) / way * (last_.x - before_last_.x);
  prescribe(forces_.constraints, model_.network.X, load_factor, 1, ahead.x);
  if (residual(ahead, load_factor).norm() < residual(state, load_factor).norm()) state = std::move(ahead);
}

StepReport QuasiStaticSolver::solve(double load_factor, State& state) {
  constexpr double kTightest = 1e-6, kLoosest = 1e-2;  // linear solves: no tighter than balance asks for
  constexpr int kMaxNewton = 100, kPatience = 100, kMaxLinear = 2000;

  StepReport report;
  if (!state.x.allFinite()) {
    report.status = Status::Diverged;
    report.residual = std::numeric_limits<double>::quiet_NaN();
    return report;
  }
  if (model_.linear) return solve_linear(load_factor, state);
  predict(load_factor, state);
  const Matrix3Xd start = state.x;
  const double far =
      (start.rowwise().maxCoeff() - start.rowwise().minCoeff()).norm();  // supports' motion included
  Matrix3Xd before = start;
  // Without a load, forces are what the rounding of positions makes of the stiffness: those are balanced.
  constexpr double kRounding = std::numeric_limits<double>::epsilon();
  double scale = kRounding * largest_stiffness_ * state.x.norm() / tolerance_;

  Objective energy;
  energy.value = [&] { return potential(model_, forces_, state, load_factor); };
  energy.negative_gradient = [&](Matrix3Xd& r) { r = residual(state, load_factor); };
  energy.is_end = [&](const Matrix3Xd& r, NewtonReport& newton) {
    // The largest forces met on the way: those at the end vanish where supports only move a body.
    scale =
        std::max({scale, load_factor * forces_.load.norm() + elastic_forces(model_, state).norm(), r.norm()});
    report.residual = scale > 0 ? r.norm() / scale : 0;
    if (report.residual <= tolerance_) return true;
    const bool is_astray = (state.x - start).colwise().norm().maxCoeff() > far;
    if (is_astray) {
      newton.status = Status::NotConverged;
      newton.reason = "the body runs away by more than its size: no equilibrium is near";
    }
    return is_astray;
  };
  energy.direction = [&](const Matrix3Xd& r, Matrix3Xd& dx) {
    const std::optional<Matrix3Xd> g = volume_stiffness_root(model_, forces_, state);
    std::vector<VolumeCurvature> curvatures;
    const auto product = [&](const Matrix3Xd& p, Matrix3Xd& y) {
      multiply(K_, p, y);
      if (g) add_rank_one(*g, p, y);
      for (const auto& [factor, F] : curvatures) add_volume_curvature(factor, *F, state.x, p, y);
      project(y);
    };
    const auto precondition = [&](const Matrix3Xd& v, Matrix3Xd& z) {
      preconditioner_->solve(v, z);
      project(z);
    };
    const double tolerance = std::clamp(tolerance_ / report.residual / 2, kTightest, kLoosest);
    const auto is_solved = [&](int max_iterations) {
      dx = Matrix3Xd::Zero(3, r.cols());
      const SolveReport linear = conjugate_gradients(product, precondition, r, dx, tolerance, max_iterations);
      report.linear_iterations += linear.iterations;
      return linear.is_converged;
    };
    // The exact Hessian converges quadratically; where it is indefinite, conjugate gradients notice and stop.
    if (model_.tet_springs && n_energies(model_) == 1) {
      K_.set_zero();
      add_hessian(*model_.tet_springs, state.x, K_, Curvature::Exact, state.patch_scale);
      curvatures = volume_curvatures(model_, forces_, state, load_factor);
      if (is_solved(kPatience)) return true;
      curvatures.clear();
    }
    K_.set_zero();
    add_stiffness(model_, state, K_);
    if (is_solved(kPatience)) return false;
    factorise(simple_stiffness(model_, state));
    is_solved(kMaxLinear);
    return false;
  };
  energy.move = [&](const Matrix3Xd& dx, double step) { state.x = before + step * dx; };
  energy.accept = [&] { before = state.x; };
  const NewtonReport newton = minimise(energy, {kMaxNewton, largest_stiffness_ * far * far});
  report.status = newton.status;
  report.newton_iterations = newton.iterations;
  report.reason = newton.reason;
  if (report.status == Status::Ok) before_last_ = std::exchange(last_, {load_factor, state.x});
  return report;
}

}  // namespace testbed::massspring
