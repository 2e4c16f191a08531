// Small motions of rigid bodies.
#pragma once

#include <Eigen/Core>
#include <string>

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

/// The six of points X (3 x n) about their mean, scaled to order 1, over 3 i + c: shifts along x, y, z, turns
/// about x, y, z.
Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X);
/// The same about a centre, and with a size that turns are scaled by (m).
Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X, const Eigen::Vector3d& centre, double size);

/// Orthonormal basis of the span of independent columns.
Eigen::MatrixXd orthonormal(const Eigen::MatrixXd& A);

/// Combinations of the six motions that supports leave free, 6 x m, m <= 6.
/// @param constrained  H^T H, 6 x 6, H what the supports hold of each motion
Eigen::MatrixXd free_combinations(const Eigen::Matrix<double, 6, 6>& constrained);

/// Orthonormal basis of the rigid motions that supports leave free, 3n x m, m <= 6.
/// @param motions      of all points, see rigid_motions
/// @param constrained  see free_combinations
Eigen::MatrixXd free_rigid_motions(const Eigen::MatrixXd& motions,
                                   const Eigen::Matrix<double, 6, 6>& constrained);

/// Parts of a load that may drive free rigid motions, of its norm: a cut surface holds a body's volume to a millionth.
constexpr double kBalanced = 1e-5;

/// That a load drives no free rigid motion.
/// @param X         3 x n (m)
/// @param free      see free_rigid_motions
/// @param load      N, 3 x n
/// @param expected  what would help, for the message
/// @throws std::runtime_error naming the free motions, net force and net torque.
void check_balance(const Eigen::Matrix3Xd& X, const Eigen::MatrixXd& free, const Eigen::Matrix3Xd& load,
                   const std::string& expected);

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

/// Likewise without the sum of some rigid motions that fits it best.
/// @param motions  6 x m, independent: translation (m) and turn (rad) about the origin
Eigen::Matrix3Xd without_motions(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& X,
                                 const Eigen::VectorXd& weights, const Eigen::MatrixXd& motions);

}  // namespace testbed::meshing
