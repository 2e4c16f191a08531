#include "meshing/algebra/rigid_motion.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  return rigid_motions(X, centre, (X.colwise() - centre).colwise().norm().maxCoeff());
}

Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X, const Eigen::Vector3d& centre, double size) {
  Eigen::MatrixXd R(X.size(), 6);
  for (int i = 0; i < X.cols(); ++i) R.middleRows<3>(3 * i) = rigid_motions_at((X.col(i) - centre) / size);
  return R;
}

Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& A) {
  return Eigen::HouseholderQR<Eigen::MatrixXd>(A).householderQ() *
         Eigen::MatrixXd::Identity(A.rows(), A.cols());
}

Eigen::MatrixXd free_combinations(const Eigen::Matrix<double, 6, 6>& constrained) {
  constexpr double kZero = 1e-10;  // squared sine of the angle at which supports hold a motion
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> eigen(constrained);
  return eigen.eigenvectors().leftCols((eigen.eigenvalues().array() < kZero).count());
}

Eigen::MatrixXd free_rigid_motions(const Eigen::MatrixXd& motions,
                                   const Eigen::Matrix<double, 6, 6>& constrained) {
  const Eigen::MatrixXd free = free_combinations(constrained);
  if (free.cols() == 0) return Eigen::MatrixXd(motions.rows(), 0);
  return orthonormal(motions * free);
}

void check_balance(const Eigen::Matrix3Xd& X, const Eigen::MatrixXd& free, const Eigen::Matrix3Xd& load,
                   const std::string& expected) {
  if ((free.transpose() * load.reshaped()).norm() <= kBalanced * load.norm()) return;
  const char* const names[] = {"shift along x", "shift along y", "shift along z",
                               "turn about x",  "turn about y",  "turn about z"};
  const Eigen::MatrixXd motions = rigid_motions(X);
  std::ostringstream what;
  what << "the supports leave " << free.cols() << " rigid motions free";
  const char* before = " (";
  for (int k = 0; k < 6; ++k) {
    constexpr double kPart = 1e-6;
    if ((free.transpose() * motions.col(k)).norm() < kPart * motions.col(k).norm()) continue;
    what << before << names[k];
    before = ", ";
  }
  const Eigen::Vector3d force = load.rowwise().sum(), centre = X.rowwise().mean();
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();
  for (int i = 0; i < X.cols(); ++i) torque += (X.col(i) - centre).cross(load.col(i));
  what << ") and the loads drive them: net force (" << force.transpose() << ") N, net torque ("
       << torque.transpose() << ") N m about the centre; expected " << expected;
  throw std::runtime_error(what.str());
}

SmallRotation best_rotation(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& X,
                            const Eigen::VectorXd& weights) {
  const Eigen::Vector3d centre = X * weights / weights.sum();
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();  // that of a translation is 0
  for (Eigen::Index i = 0; i < u.cols(); ++i) {
    const Eigen::Vector3d d = X.col(i) - centre;
    inertia += weights(i) * (d.squaredNorm() * Eigen::Matrix3d::Identity() - d * d.transpose());
    moment += weights(i) * d.cross(u.col(i));
  }
  return {centre, inertia.ldlt().solve(moment)};
}

Eigen::Matrix3Xd without_rigid_motion(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& X,
                                      const Eigen::VectorXd& weights) {
  const SmallRotation w = best_rotation(u, X, weights);
  Eigen::Matrix3Xd rest = u.colwise() - Eigen::Vector3d(u * weights / weights.sum());
  for (Eigen::Index i = 0; i < u.cols(); ++i)
    rest.col(i) -= w.angle.cross(Eigen::Vector3d(X.col(i) - w.centre));
  return rest;
}

Eigen::Matrix3Xd without_motions(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& X,
                                 const Eigen::VectorXd& weights, const Eigen::MatrixXd& motions) {
  if (motions.cols() == 0) return u;
  const Eigen::Vector3d mean = X * weights / weights.sum();
  Eigen::MatrixXd about_mean = motions, moved(u.size(), motions.cols());
  about_mean.topRows<3>() -= cross_product_matrix(mean) * motions.bottomRows<3>();
  for (Eigen::Index i = 0; i < u.cols(); ++i)
    moved.middleRows<3>(3 * i) = rigid_motions_at(X.col(i) - mean) * about_mean;
  const Eigen::VectorXd root = weights.cwiseSqrt().transpose().replicate(3, 1).reshaped();
  const Eigen::VectorXd sum =
      (root.asDiagonal() * moved).colPivHouseholderQr().solve(root.cwiseProduct(u.reshaped()));
  return u - (moved * sum).reshaped(3, u.cols());
}

}  // namespace testbed::meshing
