#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "meshing/surface/surface.h"
#include "meshing/surface_energies/enclosed_volume.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kDifferenceStep = 1e-5, kDifferenceTolerance = 1e-8, kRounding = 1e-13;

class VolumeForce : public testing::Test {
 protected:
  const MassSpringModel model = small_model();
  const Eigen::Matrix3Xi F = model.network.F;
  const Matrix3Xd x = 1.2 * model.network.X + random_points(5, 0.1, 5);
  const double P = 30, target = 0.4;
  Matrix3Xd forces(const Matrix3Xd& at) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, 5);
    add_volume_forces(P, target, F, at, f);
    return f;
  }
};

TEST_F(VolumeForce, IsMinusEnergyGradient) {
  const Matrix3Xd f = forces(x);
  ASSERT_GT(f.norm(), 0.1);
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x;
    up(k) += kDifferenceStep;
    down(k) -= kDifferenceStep;
    const double slope =
        (volume_energy(P, target, F, up) - volume_energy(P, target, F, down)) / (2 * kDifferenceStep);
    EXPECT_NEAR(f(k), -slope, kDifferenceTolerance * f.norm());
  }
}

TEST_F(VolumeForce, RankOneTermIsTheWholeHessianAtTheTarget) {
  const double at_target = volume(x, F);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(x.size());  // 0 at the node inside
  const Matrix3Xd on_surface = meshing::volume_stiffness_root(P, at_target, F, x);
  g.head(on_surface.size()) = on_surface.reshaped();
  ASSERT_GT(g.norm(), 0.1);
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x, f_up = Matrix3Xd::Zero(3, 5), f_down = f_up;
    up(k) += kDifferenceStep;
    down(k) -= kDifferenceStep;
    add_volume_forces(P, at_target, F, up, f_up);
    add_volume_forces(P, at_target, F, down, f_down);
    const Eigen::VectorXd column = (f_up - f_down).reshaped() / (2 * kDifferenceStep);
    EXPECT_LT((g * g(k) + column).norm(), kDifferenceTolerance * g.squaredNorm());
  }
}

// The volume is cubic in the positions, for which mixed central differences are exact but for kRounding.
TEST_F(VolumeForce, CurvatureIsTheSecondDifferenceOfTheVolume) {
  constexpr double kFactor = 3, kStep = 0.5;
  const Matrix3Xd p = random_points(5, 1, 6), start = random_points(5, 1, 7);
  Matrix3Xd y = start;
  add_volume_curvature(kFactor, F, x, p, y);
  y -= start;
  ASSERT_GT(y.norm(), 0.1);
  for (int k = 0; k < x.size(); ++k) {
    const auto change = [&](double along_p) {
      Matrix3Xd up = x + along_p * p, down = up;
      up(k) += kStep;
      down(k) -= kStep;
      return volume(up, F) - volume(down, F);
    };
    EXPECT_NEAR(y(k), kFactor * (change(kStep) - change(-kStep)) / (4 * kStep * kStep), kRounding * 100);
  }
}

TEST_F(VolumeForce, KeepsLinearAndAngularMomentum) {
  const Matrix3Xd f = forces(x);
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();
  for (int i = 0; i < 5; ++i) torque += x.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), kRounding * f.norm());
  EXPECT_LT(torque.norm(), kRounding * f.norm());
}

}  // namespace
}  // namespace testbed::massspring
