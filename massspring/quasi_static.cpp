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

/// Stiffness of the model, or where springs are coupled of its single tetrahedra alone, which is sparser.
BlockMatrix simple_stiffness(const MassSpringModel& model, const State& state) {
  if (!model.tet_springs) {
    BlockMatrix K = stiffness_pattern(model);
    add_stiffness(model, state, K);
    return K;
  }
  const TetSprings simple =
      couple_springs(model.network.X, model.network.T, lame_of(model.material), edge_coupled);
  BlockMatrix K = make_block_matrix(static_cast<int>(state.x.cols()), pairs_of(simple));
  add_hessian(simple, state.x, K);
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
  factorise(initial_state(model), 0);
}

void QuasiStaticSolver::factorise(const State& state, double shift) {
  constexpr double kLeastShift = 1e-8;  // so that a factor exists where rigid motions or mechanisms are free
  BlockMatrix P = simple_stiffness(model_, state);
  if (stiffness_scale_ == 0)
    for (int i = 0; i < P.rows(); ++i)
      stiffness_scale_ = std::max(stiffness_scale_, P.block[P.find(i, i)].diagonal().maxCoeff());
  for (int i = 0; i < P.rows(); ++i)
    P.block[P.find(i, i)].diagonal().array() += std::max(shift, kLeastShift) * stiffness_scale_;
  filter(forces_.constraints, P);
  preconditioner_ = std::make_unique<BlockCholesky>(P);
  if (!preconditioner_->is_ok())
    throw std::runtime_error("the stiffness has no Cholesky factor, expected a positive definite model");
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
  constexpr double kTolerance = 1e-9, kLinearTolerance = 1e-6, kSufficientDecrease = 1e-4, kGoodGain = 0.75,
                   kPoorGain = 0.25;
  constexpr double kFirstShift = 1e-8, kLargestShift = 1e3;
  constexpr int kMaxNewton = 200, kMaxLinear = 100, kMaxHalvings = 30;

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

    K_.set_zero();
    add_stiffness(model_, state, K_);
    const auto product = [&](const Matrix3Xd& p, Matrix3Xd& y) {
      multiply(K_, p, y);
      if (shift > 0) y += shift * stiffness_scale_ * p;
      project(y);
    };
    const auto precondition = [&](const Matrix3Xd& v, Matrix3Xd& z) {
      preconditioner_->solve(v, z);
      project(z);
    };
    Matrix3Xd dx = Matrix3Xd::Zero(3, r.cols());
    SolveReport linear = conjugate_gradients(product, precondition, r, dx, kLinearTolerance, kMaxLinear);
    report.linear_iterations += linear.iterations;
    if (!linear.is_converged) {
      factorise(state, shift);
      dx.setZero();
      linear = conjugate_gradients(product, precondition, r, dx, kLinearTolerance, kMaxLinear);
      report.linear_iterations += linear.iterations;
    }

    // A mechanism's step has no bound: accept none that is wild or does not lower the energy.
    bool is_accepted = false;
    double step = 1,
           gain = 0;  // decrease of the energy over what the quadratic model promised for the full step
    const double slope = -r.cwiseProduct(dx).sum(), before = potential(state, load_factor);
    if (dx.allFinite() && slope < 0 && dx.colwise().norm().maxCoeff() < size) {
      State trial = state;
      for (int halving = 0; halving < kMaxHalvings && !is_accepted; ++halving, step /= 2) {
        trial.x = state.x + step * dx;
        gain = (potential(trial, load_factor) - before) / (slope / 2);
        // Near equilibrium the energy is flat to rounding; there the balance of forces decides.
        if (residual(trial, load_factor).norm() < 0.5 * r.norm()) gain = 1;
        is_accepted = gain >= 2 * kSufficientDecrease * step;
      }
      if (is_accepted) state.x = trial.x;
    }
    if (linear.is_converged && gain > kGoodGain)
      shift = shift > kFirstShift ? shift / 10 : 0;
    else if (!linear.is_converged || gain < kPoorGain)
      shift = std::max(10 * shift, kFirstShift);
    ++report.newton_iterations;
  }
  report.status = Status::NotConverged;
  return report;
}

}  // namespace testbed
