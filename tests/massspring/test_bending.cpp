#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "massspring/bending.h"
#include "meshing/shapes.h"
#include "tests/massspring/small_network.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

constexpr double kStep = 1e-6, kDifference = 1e-7, kRounding = 1e-12;

class BentSurface : public testing::Test {
 protected:
  const SurfaceMesh ball = make_shape("ball", 42);
  const Bending bending = make_bending(ball.X, ball.F, 0.3);
  const Matrix3Xd x = 1.1 * ball.X + random_points(static_cast<int>(ball.X.cols()), 0.15, 3);
  static Matrix3Xd forces(const Bending& bending, const Matrix3Xd& at) {
    Matrix3Xd f = Matrix3Xd::Zero(3, at.cols());
    add_forces(bending, at, f);
    return f;
  }
  Matrix3Xd forces(const Matrix3Xd& at) const { return forces(bending, at); }
  void expect_minus_energy_gradient(const Bending& bending, const Matrix3Xd& f) const {
    for (int k = 0; k < x.size(); ++k) {
      Matrix3Xd up = x, down = x;
      up(k) += kStep;
      down(k) -= kStep;
      EXPECT_NEAR(f(k), -(energy(bending, up) - energy(bending, down)) / (2 * kStep), kDifference * f.norm());
    }
  }
};

TEST_F(BentSurface, ForceIsMinusEnergyGradient) {
  const Matrix3Xd f = forces(x);
  ASSERT_GT(f.norm(), 0.1);
  expect_minus_energy_gradient(bending, f);
}

TEST_F(BentSurface, ForceIsMinusEnergyGradientWhereTrianglesCrumple) {
  Bending large = bending;
  large.area *= 20;  // all triangles have shrunk to a fraction of a tenth of these
  const Matrix3Xd f = forces(large, x);
  ASSERT_GT((f - forces(x)).norm(), 0.1 * f.norm());
  expect_minus_energy_gradient(large, f);
}

TEST_F(BentSurface, HessianIsMinusForceGradientAtRest) {
  BlockMatrix K = make_block_matrix(static_cast<int>(x.cols()), pairs_of(bending));
  add_hessian(bending, ball.X, K);
  const Matrix3Xd p = random_points(static_cast<int>(x.cols()), 1, 4);
  Matrix3Xd Kp;
  multiply(K, p, Kp);
  ASSERT_GT(Kp.norm(), 0.1);
  const Matrix3Xd difference = (forces(ball.X - kStep * p) - forces(ball.X + kStep * p)) / (2 * kStep);
  EXPECT_LT((Kp - difference).norm(), kDifference * Kp.norm());
}

TEST_F(BentSurface, RigidMotionCostsNothingAndMomentumIsKept) {
  const Eigen::Matrix3d R = Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, 2, 3).normalized()).matrix();
  EXPECT_LT(forces((R * ball.X).colwise() + Eigen::Vector3d(1, -2, 3)).norm(), kRounding);
  const Matrix3Xd f = forces(x);
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();
  for (int i = 0; i < x.cols(); ++i) torque += x.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), kRounding * f.norm());
  EXPECT_LT(torque.norm(), kRounding * f.norm());
}

TEST(Bending, RegularTetrahedronHasItsDihedralAngleAndEnergyByHand) {
  Matrix3Xd X(3, 4);
  X << 1, 1, -1, -1,  //
      1, -1, 1, -1,   //
      1, -1, -1, 1;
  Eigen::Matrix3Xi F(3, 4);
  F << 0, 0, 0, 1,  //
      1, 3, 2, 3,   //
      2, 1, 3, 2;
  Bending bending = make_bending(X, F, 2);
  ASSERT_EQ(bending.hinges.cols(), 6);
  for (int b = 0; b < 6; ++b) {
    EXPECT_NEAR(std::abs(bending.rest_angle[b]), std::acos(-1.0 / 3), kRounding);  // between normals
    EXPECT_NEAR(bending.stiffness[b], 2 * 8 / (2 * 2 * std::sqrt(3.0)), kRounding);
  }
  bending.rest_angle.array() -= 0.1;
  EXPECT_NEAR(energy(bending, X), 6 * bending.stiffness[0] * 0.01 / 2, kRounding);
}

// Two triangles of height 1, one of which is flattened to ever smaller heights: 2 t (2 - t) pi / height
// grows to 4 pi / 0.1 and no further.
TEST(Bending, PushOfACrumpledTriangleIsBounded) {
  Matrix3Xd X(3, 4);
  X << 0, 1, 0.5, 0.5,  //
      0, 0, 1, -1,      //
      0, 0, 0, 1;
  Bending bending;
  bending.hinges = Eigen::Vector4i(0, 1, 2, 3);
  bending.area = Eigen::Vector2d(0.5, 0.5);
  bending.rest_angle = Eigen::VectorXd::Zero(1);
  bending.stiffness = Eigen::VectorXd::Ones(1);
  double largest = 0;
  for (double height = 1; height > 1e-9; height /= 3) {
    X(1, 2) = height;
    Matrix3Xd f = Matrix3Xd::Zero(3, 4);
    add_forces(bending, X, f);
    largest = std::max(largest, f.col(2).norm());
  }
  EXPECT_GT(largest, 2);
  EXPECT_LT(largest, 4 * M_PI / 0.1);
}

}  // namespace
}  // namespace testbed
