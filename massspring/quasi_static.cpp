#include "massspring/quasi_static.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "massspring/conjugate_gradients.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

/// Orthonormal basis of the rigid motions of X that leave every constrained direction at rest, 3n x m, m
/// <= 6.
Eigen::MatrixXd free_rigid_motions(const Matrix3Xd& X, const std::vector<Constraint>& constraints) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  const double size = (X.colwise() - centre).colwise().norm().maxCoeff();
  Eigen::MatrixXd R(X.size(), 6);
  for (int i = 0; i < X.cols(); ++i) {
    const Eigen::Vector3d d = (X.col(i) - centre) / size;
    R.block<3, 3>(3 * i, 0).setIdentity();
    for (int k = 0; k < 3; ++k) R.block<3, 1>(3 * i, 3 + k) = Eigen::Vector3d::Unit(k).cross(d);
  }
  Eigen::Matrix<double, 6, 6> held = Eigen::Matrix<double, 6, 6>::Zero();
  for (const Constraint& c : constraints) {
    const Eigen::Matrix<double, 3, 6> moved =
        (Eigen::Matrix3d::Identity() - c.S) * R.middleRows<3>(3 * c.node);
    held += moved.transpose() * moved;
  }
  constexpr double kZero = 1e-10;  // squared sines of the angles at which supports hold a motion
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(held);
  const int m = static_cast<int>((eigen.eigenvalues().array() < kZero).count());
  if (m == 0) return Eigen::MatrixXd(X.size(), 0);
  const Eigen::MatrixXd free = R * eigen.eigenvectors().leftCols(m);
  return Eigen::HouseholderQR<Eigen::MatrixXd>(free).householderQ() * Eigen::MatrixXd::Identity(X.size(), m);
}

/// Stiffness at rest of a sparser or equal model, shifted so that it has a factor even where the network is a
/// mechanism.
BlockMatrix preconditioner_matrix(const MassSpringModel& model, const State& rest, double& scale) {
  BlockMatrix K;
  if (model.tet_springs) {
    const TetSprings simple =
        couple_springs(model.network.X, model.network.T, lame_of(model.material), edge_coupled);
    K = make_block_matrix(static_cast<int>(rest.x.cols()), pairs_of(simple));
    add_hessian(simple, rest.x, K);
  } else {
    K = stiffness_pattern(model);
    add_stiffness(model, rest, K);
  }
  scale = 0;
  for (int i = 0; i < K.rows(); ++i) scale = std::max(scale, K.block[K.find(i, i)].diagonal().maxCoeff());
  constexpr double kShift = 1e-7;
  for (int i = 0; i < K.rows(); ++i) K.block[K.find(i, i)].diagonal().array() += kShift * scale;
  return K;
}

}  // namespace

QuasiStaticSolver::QuasiStaticSolver(const MassSpringModel& model, const Forces& forces)
    : model_(model),
      forces_(forces),
      rigid_motions_(free_rigid_motions(model.network.X, forces.constraints)) {
  const Eigen::Map<const Eigen::VectorXd> load(forces.load.data(), forces.load.size());
  constexpr double kBalanced = 1e-8;  // rounding of a sum over many nodes
  if ((rigid_motions_.transpose() * load).norm() > kBalanced * load.norm()) {
    const Eigen::Vector3d force = forces.load.rowwise().sum(), centre = model.network.X.rowwise().mean();
    Eigen::Vector3d torque = Eigen::Vector3d::Zero();
    for (int i = 0; i < forces.load.cols(); ++i)
      torque += (model.network.X.col(i) - centre).cross(forces.load.col(i));
    std::ostringstream what;
    what << "the supports leave " << n_free_rigid_motions()
         << " rigid motions free and the loads drive them: net force (" << force.transpose()
         << ") N, net torque (" << torque.transpose()
         << ") N m about the centre; expected more supports or balanced loads";
    throw std::runtime_error(what.str());
  }
  K_ = stiffness_pattern(model);
  BlockMatrix P = preconditioner_matrix(model, initial_state(model), stiffness_scale_);
  filter(forces.constraints, P);
  preconditioner_ = std::make_unique<BlockCholesky>(P);
  if (!preconditioner_->is_ok())
    throw std::runtime_error(
        "the stiffness at rest has no Cholesky factor, expected a positive definite model");
}

void QuasiStaticSolver::project(Matrix3Xd& y) const {
  filter(forces_.constraints, y);
  if (rigid_motions_.cols() == 0) return;
  Eigen::Map<Eigen::VectorXd> flat(y.data(), y.size());
  flat -= rigid_motions_ * (rigid_motions_.transpose() * flat).eval();
}

Matrix3Xd QuasiStaticSolver::residual(const State& state, double load_factor) const {
  Matrix3Xd r = elastic_forces(model_, state) + load_factor * forces_.load;
  project(r);
  return r;
}

double QuasiStaticSolver::potential(const State& state, double load_factor) const {
  return elastic_energy(model_, state) -
         load_factor * forces_.load.cwiseProduct(state.x - model_.network.X).sum();
}

StepReport QuasiStaticSolver::solve(double load_factor, State& state) {
  constexpr double kTolerance = 1e-9, kLinearTolerance = 1e-6, kSufficientDecrease = 1e-4;
  constexpr double kFirstShift = 1e-6, kLargestShift = 1e3;
  constexpr int kMaxNewton = 200, kMaxLinear = 500, kMaxHalvings = 30;

  prescribe(forces_.constraints, model_.network.X, load_factor, state.x);
  const double size = (model_.network.X.rowwise().maxCoeff() - model_.network.X.rowwise().minCoeff()).norm();
  StepReport report;
  double shift = 0;
  for (Matrix3Xd r = residual(state, load_factor);; r = residual(state, load_factor)) {
    const double scale = load_factor * forces_.load.norm() + elastic_forces(model_, state).norm();
    report.residual = scale > 0 ? r.norm() / scale : 0;
    if (!std::isfinite(report.residual)) {
      report.status = Status::Diverged;
      return report;
    }
    if (report.residual <= kTolerance) return report;
    if (report.newton_iterations == kMaxNewton || shift > kLargestShift) break;

    const auto product = [&](const Matrix3Xd& p, Matrix3Xd& y) {
      multiply(K_, p, y);
      if (shift > 0) y += shift * stiffness_scale_ * p;
      project(y);
    };
    const auto precondition = [&](const Matrix3Xd& v, Matrix3Xd& z) {
      preconditioner_->solve(v, z);
      project(z);
    };
    Matrix3Xd dx;
    SolveReport linear;
    const auto solve_linear = [&] {
      dx = Matrix3Xd::Zero(3, r.cols());
      linear = conjugate_gradients(product, precondition, r, dx, kLinearTolerance, kMaxLinear);
      report.linear_iterations += linear.iterations;
    };
    // The exact Hessian converges quadratically; where it is indefinite, conjugate gradients notice and stop.
    if (model_.tet_springs && !model_.springs) {
      K_.set_zero();
      add_hessian(*model_.tet_springs, state.x, K_, Curvature::Exact);
      solve_linear();
    }
    if (!linear.is_converged) {
      K_.set_zero();
      add_stiffness(model_, state, K_);
      solve_linear();
    }

    // A mechanism's step has no bound: accept none that is wild or does not lower the energy.
    bool is_accepted = false;
    const double slope = -r.cwiseProduct(dx).sum(), before = potential(state, load_factor);
    if (dx.allFinite() && slope < 0 && dx.colwise().norm().maxCoeff() < size) {
      State trial = state;
      double step = 1;
      for (int halving = 0; halving < kMaxHalvings && !is_accepted; ++halving, step /= 2) {
        trial.x = state.x + step * dx;
        // Near equilibrium the energy is flat to rounding; there the balance of forces decides.
        is_accepted = potential(trial, load_factor) <= before + kSufficientDecrease * step * slope ||
                      residual(trial, load_factor).norm() < 0.5 * r.norm();
      }
      if (is_accepted) state.x = trial.x;
    }
    if (is_accepted && linear.is_converged)
      shift = shift > kFirstShift ? shift / 10 : 0;
    else
      shift = std::max(10 * shift, kFirstShift);
    ++report.newton_iterations;
  }
  report.status = Status::NotConverged;
  return report;
}

}  // namespace testbed
