#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "meshing/algebra/rigid_motion.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kRounding = 1e-14;
constexpr int n = 7;

TEST(RigidMotion, OfAPointIsTheTranslationAndTheRotationTimesItsOffset) {
  const Matrix3Xd p = random_points(3, 1, 1);
  const Vector3d d = p.col(0), translation = p.col(1), rotation = p.col(2);
  Eigen::Matrix<double, 6, 1> motion;
  motion << translation, rotation;
  EXPECT_LT((rigid_motions_at(d) * motion - translation - rotation.cross(d)).norm(), kRounding);
  EXPECT_LT((cross_product_matrix(rotation) * d - rotation.cross(d)).norm(), kRounding);
}

// Two points constrained in all directions leave the turn about the line through them.
TEST(RigidMotion, FreeOnesKeepAllDistancesAndWhatIsConstrained) {
  const Matrix3Xd X = random_points(n, 1, 2);
  const Eigen::MatrixXd R = rigid_motions(X);
  const Eigen::MatrixXd constrained = R.topRows<6>(),
                        free = free_rigid_motions(R, constrained.transpose() * constrained);
  ASSERT_EQ(free.cols(), 1);
  EXPECT_NEAR(free.norm(), 1, kRounding);
  const Matrix3Xd u = free.reshaped(3, n);
  EXPECT_LT(u.leftCols(2).norm(), 100 * kRounding);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < i; ++j)
      EXPECT_LT(std::abs((X.col(i) - X.col(j)).dot(u.col(i) - u.col(j))), 100 * kRounding);
  EXPECT_EQ(free_rigid_motions(R, R.transpose() * R).cols(), 0);
}

TEST(RigidMotion, AreDrivenByLoadsThatAreNotBalanced) {
  const Matrix3Xd X = random_points(n, 1, 2);
  const Eigen::MatrixXd free = free_rigid_motions(rigid_motions(X), Eigen::Matrix<double, 6, 6>::Zero());
  Matrix3Xd load = Matrix3Xd::Zero(3, n);
  load.col(0) = X.col(1) - X.col(0);
  load.col(1) = -load.col(0);
  EXPECT_NO_THROW(check_balance(X, free, load, ""));
  const Vector3d balanced = load.col(1);
  load.col(1) *= 1 + 1e-6;
  EXPECT_NO_THROW(check_balance(X, free, load, "")) << "as far as a cut surface is the body's";
  for (const double part : {1 + 1e-4, 0.}) {
    load.col(1) = part * balanced;
    EXPECT_THROW(check_balance(X, free, load, ""), std::runtime_error);
  }
}

TEST(RigidMotion, BestRotationIsThatOfABodyThatTurnsAsItGoes) {
  const Matrix3Xd X = random_points(n, 1, 2);
  const Eigen::VectorXd weights = random_points(n, 1, 3).row(0).cwiseAbs();
  const Vector3d angle(0.3, -0.2, 0.5), translation(1, 2, 3);
  Matrix3Xd u(3, n);
  for (int i = 0; i < n; ++i) u.col(i) = translation + angle.cross(X.col(i));
  const SmallRotation best = best_rotation(u, X, weights);
  EXPECT_LT((best.angle - angle).norm(), 100 * kRounding);
  EXPECT_LT((best.centre - X * weights / weights.sum()).norm(), kRounding);
}

// The weighted mean square of what is left is at its minimum over translations and rotations.
TEST(RigidMotion, BestRotationOfAnyFieldLeavesNoWeightedMoment) {
  const Matrix3Xd X = random_points(n, 1, 2), u = random_points(n, 1, 4);
  const Eigen::VectorXd weights = random_points(n, 1, 3).row(0).cwiseAbs();
  const SmallRotation best = best_rotation(u, X, weights);
  Vector3d moment = Vector3d::Zero();
  for (int i = 0; i < n; ++i) {
    const Vector3d d = X.col(i) - best.centre;
    moment += weights(i) * d.cross(u.col(i) - best.angle.cross(d));
  }
  EXPECT_LT(moment.norm(), 100 * kRounding);
}

}  // namespace
}  // namespace testbed::massspring
