// Small motions of rigid bodies.
#pragma once

#include <Eigen/Core>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// The matrix that takes b to a x b.
inline Eigen::Matrix3d cross_product_matrix(const Eigen::Vector3d& a) {
  Eigen::Matrix3d C;
  C << 0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0;
  return C;
}

/// How a point at an offset d from the centre of a rigid body moves with the body's translation and rotation.
inline Eigen::Matrix<double, 3, 6> rigid_motions_at(const Eigen::Vector3d& d) {
  Eigen::Matrix<double, 3, 6> R;
  R << Eigen::Matrix3d::Identity(), -cross_product_matrix(d);
  return R;
}

/// A small rotation about a centre, besides the centre's own translation.
struct SmallRotation {
  Eigen::Vector3d centre, angle;
};

/// The one that fits small displacements u of points X (both 3 x n) best in the weighted mean square.
SmallRotation best_rotation(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& X,
                            const Eigen::VectorXd& weights);

/// u without the small rigid motion that fits it best, likewise.
Eigen::Matrix3Xd without_rigid_motion(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& X,
                                      const Eigen::VectorXd& weights);

}  // namespace testbed::meshing
