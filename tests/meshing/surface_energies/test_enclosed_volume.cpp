#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

Matrix3Xd curved_triangle(int n) {
  Matrix3Xd x(3, 6);
  x << 0, 1, .1, .5, .6, 0,   //
      .1, 0, 1, -.1, .6, .5,  //
      1, 1.1, .9, 1.2, 1, 1.1;
  return x.leftCols(n);
}

TEST(EnclosedVolume, OfAClosedSurfaceIsItsVolume) {
  const TetMesh box = box_tets(2, 1, 1, 1, 0.2);
  double sum = 0;
  for (int f = 0; f < box.F.cols(); ++f) sum += enclosed_volume(box.X(Eigen::all, box.F.col(f))).volume;
  EXPECT_NEAR(sum, volume(box.X, box.F), 1e-14);
}

// Over the unit triangle of the plane, z = 1 + a x y between it and the origin: (1/2 - a/24) / 3.
TEST(EnclosedVolume, OfSixNodesIsThatUnderTheCurvedTriangle) {
  for (double a : {0., 0.7}) {
    Matrix3Xd x(3, 6);
    x << 0, 1, 0, .5, .5, 0,  //
        0, 0, 1, 0, .5, .5,   //
        1, 1, 1, 1, 1 + a / 4, 1;
    EXPECT_NEAR(enclosed_volume(x).volume, (0.5 - a / 24) / 3, 1e-14);
  }
}

// Squares of the barycentric coordinates: sqrt(x) + sqrt(y) + sqrt(z) = 1, under which there is 1/90.
TEST(EnclosedVolume, OfATriangleCurvedInEveryDirectionIsItsIntegral) {
  Matrix3Xd x(3, 6);
  x << 1, 0, 0, .25, 0, .25,  //
      0, 1, 0, .25, .25, 0,   //
      0, 0, 1, 0, .25, .25;
  EXPECT_NEAR(enclosed_volume(x).volume, 1. / 90, 1e-15);
}

TEST(EnclosedVolume, DerivativesAreDifferences) {
  constexpr double h = 1e-4, kTolerance = 1e-7;  // central differences of a cubic
  for (int n : {3, 6}) {
    const Matrix3Xd x = curved_triangle(n);
    const EnclosedVolume v = enclosed_volume(x);
    EXPECT_GT(v.gradient.norm(), 0.1);
    EXPECT_GT(v.hessian.norm(), 0.1);
    for (int k = 0; k < 3 * n; ++k) {
      Matrix3Xd plus = x, minus = x;
      plus.data()[k] += h;
      minus.data()[k] -= h;
      const EnclosedVolume above = enclosed_volume(plus), below = enclosed_volume(minus);
      EXPECT_NEAR(v.gradient.data()[k], (above.volume - below.volume) / (2 * h), kTolerance);
      EXPECT_LT((v.hessian.col(k) - (above.gradient - below.gradient).reshaped() / (2 * h)).norm(),
                kTolerance);
    }
  }
}

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

/// A ball of six-node triangles whose middles lie on the sphere, or of straight ones.
FollowerPressure ball_under_pressure(int n, Matrix3Xd& x) {
  const SurfaceMesh ball = make_shape("ball", 42);
  const Eigen::Matrix2Xi edges = edges_of(ball.F);
  const int n_corners = static_cast<int>(ball.X.cols());
  x.resize(3, n_corners + (n == 6 ? edges.cols() : 0));
  x.leftCols(n_corners) = ball.X;
  Eigen::MatrixXi faces(n, ball.F.cols());
  faces.topRows<3>() = ball.F;
  for (int e = 0; n == 6 && e < edges.cols(); ++e) {
    const Eigen::Vector3d middle = (ball.X.col(edges(0, e)) + ball.X.col(edges(1, e))) / 2;
    x.col(n_corners + e) = ball.X.col(0).norm() * middle.normalized();
    for (int f = 0; f < faces.cols(); ++f)
      for (int k = 0; k < 3; ++k)
        if (std::minmax(faces(k, f), faces((k + 1) % 3, f)) == std::minmax(edges(0, e), edges(1, e)))
          faces(3 + k, f) = n_corners + e;
  }
  const std::vector<FollowerPressure> followers =
      followers_of(Eigen::VectorXd::Constant(faces.cols(), 40.), faces);
  EXPECT_EQ(followers.size(), 1u);
  return followers[0];
}

TEST(FollowerPressure, ForcesAndHessianAreDifferencesOnStraightAndCurvedTriangles) {
  for (const int n : {3, 6}) {
    Matrix3Xd x;
    const FollowerPressure follower = ball_under_pressure(n, x);
    const int n_nodes = static_cast<int>(x.cols());
    const Matrix3Xd p = random_points(n_nodes, 1, 6);
    const auto forces = [&](const Matrix3Xd& at) {
      Matrix3Xd f = Matrix3Xd::Zero(3, n_nodes);
      add_forces(follower, at, f);
      return f;
    };
    const Matrix3Xd up = x + kDifferenceStep * p, down = x - kDifferenceStep * p, f = forces(x);
    ASSERT_GT(f.norm(), 1);
    EXPECT_NEAR(f.cwiseProduct(p).sum(),
                (energy(follower, down) - energy(follower, up)) / (2 * kDifferenceStep),
                kDifferenceTolerance * f.norm() * p.norm());
    Matrix3Xd Kp = Matrix3Xd::Zero(3, n_nodes);
    for_each_hessian_block(follower, x, [&](int i, int j, const Eigen::Matrix3d& block) {
      Kp.col(i) += block * p.col(j);
      if (i != j) Kp.col(j) += block.transpose() * p.col(i);
    });
    ASSERT_GT(Kp.norm(), 1);
    EXPECT_LT((Kp - (forces(down) - forces(up)) / (2 * kDifferenceStep)).norm(),
              kDifferenceTolerance * Kp.norm());
  }
}

// Curved triangles on the sphere have its volume to a power of the edge that straight ones have not.
TEST(FollowerPressure, OfACurvedBallIsThatOfTheSphere) {
  Matrix3Xd x;
  const double V = 4 * M_PI / 3 * std::pow(make_shape("ball", 42).X.col(0).norm(), 3);
  EXPECT_NEAR(energy(ball_under_pressure(6, x), x) / 40, V, 0.01 * V);
  EXPECT_LT(energy(ball_under_pressure(3, x), x) / 40, 0.95 * V);
}

}  // namespace
}  // namespace testbed::massspring
