#include "meshing/algebra/rigid_motion.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

namespace testbed::meshing {

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

}  // namespace testbed::meshing
