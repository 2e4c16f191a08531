#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "meshing/surface/shapes.h"
#include "meshing/surface_energies/bending.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
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
  static Matrix3Xd product(const Bending& bending, const Matrix3Xd& at, const Matrix3Xd& p,
                           Curvature curvature) {
    BlockMatrix K = make_block_matrix(static_cast<int>(at.cols()), pairs_of(bending));
    add_hessian(bending, at, K, curvature);
    mirror(K);
    Matrix3Xd Kp;
    multiply(K, p, Kp);
    return Kp;
  }
  static void expect_minus_force_gradient(const Bending& bending, const Matrix3Xd& at, Curvature curvature) {
    const Matrix3Xd p = random_points(static_cast<int>(at.cols()), 1, 4),
                    Kp = product(bending, at, p, curvature),
                    difference =
                        (forces(bending, at - kStep * p) - forces(bending, at + kStep * p)) / (2 * kStep);
    ASSERT_GT(Kp.norm(), 0.1);
    EXPECT_LT((Kp - difference).norm(), kDifference * Kp.norm());
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

TEST_F(BentSurface, OfAPatchIsThatOfTheEdgesBetweenItsTriangles) {
  const Bending patch = make_bending(ball.X, ball.F.leftCols(30), 0.3);
  EXPECT_LT(patch.hinges.cols(), 45) << "some edges have one triangle";
  std::vector<int> places;
  for (int b = 0; b < bending.hinges.cols(); ++b)
    if ((patch.hinges.colwise() - bending.hinges.col(b)).cwiseAbs().colwise().sum().minCoeff() == 0)
      places.push_back(b);
  ASSERT_EQ(places.size(), patch.hinges.cols());
  EXPECT_EQ(energy(part_of(bending, places), x), energy(patch, x));
}

TEST_F(BentSurface, HessianInBlocksIsThatOfThePattern) {
  const Matrix3Xd p = random_points(static_cast<int>(x.cols()), 1, 4);
  for (const Curvature curvature : {Curvature::Exact, Curvature::Projected}) {
    SurfaceHessian H;
    PlainEnergy<Bending>(bending).add_hessian(x, H, curvature);
    Matrix3Xd Kp = Matrix3Xd::Zero(3, x.cols());
    H.add_product(p, Kp);
    EXPECT_LT((Kp - product(bending, x, p, curvature)).norm(), kRounding * Kp.norm());
  }
}

TEST_F(BentSurface, HessianButForAnglesIsTheProjectedOne) {
  const Matrix3Xd p = random_points(static_cast<int>(x.cols()), 1, 4);
  EXPECT_EQ(product(bending, x, p, Curvature::ExactButAngles), product(bending, x, p, Curvature::Projected));
}

TEST_F(BentSurface, ProjectedHessianIsMinusForceGradientAtRest) {
  expect_minus_force_gradient(bending, ball.X, Curvature::Projected);
}

TEST_F(BentSurface, ProjectedHessianHasNoNegativeEigenvalue) {
  BlockMatrix K = make_block_matrix(static_cast<int>(x.cols()), pairs_of(bending));
  add_hessian(bending, x, K, Curvature::Projected);
  mirror(K);
  const Eigen::VectorXd eigenvalues = dense(K).selfadjointView<Eigen::Lower>().eigenvalues();
  EXPECT_GT(eigenvalues.minCoeff(), -kRounding * eigenvalues.maxCoeff());
}

TEST_F(BentSurface, ExactHessianIsMinusForceGradient) {
  expect_minus_force_gradient(bending, x, Curvature::Exact);
}

TEST_F(BentSurface, ExactHessianIsMinusForceGradientWhereTrianglesCrumple) {
  Bending large = bending;
  large.area *= 20;
  expect_minus_force_gradient(large, x, Curvature::Exact);
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

// A corner cut off a box: every edge at the corner is convex by a right angle, and its triangles differ.
TEST(Bending, HingeOfUnequalTrianglesHasItsStiffnessAndItsConvexAngleByHand) {
  Matrix3Xd X(3, 4);
  X << 0, 2, 0, 0,  //
      0, 0, 3, 0,   //
      0, 0, 0, 1;
  Eigen::Matrix3Xi F(3, 4);
  F << 0, 0, 0, 1,  //
      2, 1, 3, 2,   //
      1, 3, 2, 3;
  constexpr double k_b = 0.7;
  const Bending bending = make_bending(X, F, k_b);
  int n_found = 0;
  for (int b = 0; b < bending.hinges.cols(); ++b) {
    if (bending.hinges.col(b).head<2>() != Eigen::Vector2i(0, 1)) continue;
    ++n_found;
    EXPECT_EQ(bending.hinges.col(b), Eigen::Vector4i(0, 1, 3, 2));
    EXPECT_NEAR(bending.area(0, b), 1, kRounding);  // of sides 2 and 1
    EXPECT_NEAR(bending.area(1, b), 3, kRounding);  // of sides 2 and 3
    EXPECT_NEAR(bending.stiffness[b], k_b * 2 * 2 / (1 + 3), kRounding);
    EXPECT_NEAR(bending.rest_angle[b], M_PI / 2, kRounding);
  }
  EXPECT_EQ(n_found, 1);
}

/// Edge of 2 m along x, a triangle of height 3 m on one side, and on the other one of height 1 m that is
/// folded down by an angle, outward being up.
Matrix3Xd folded(double angle) {
  Matrix3Xd x(3, 4);
  x << 0, 2, 0.3, 0.8,            //
      0, 0, 3, -std::cos(angle),  //
      0, 0, 0, -std::sin(angle);
  return x;
}

Bending hinge_of_unequal_triangles(double rest_angle) {
  Bending bending;
  bending.hinges = Eigen::Vector4i(0, 1, 2, 3);
  bending.area = Eigen::Vector2d(3, 1);
  bending.rest_angle = Eigen::VectorXd::Constant(1, rest_angle);
  bending.stiffness = Eigen::VectorXd::Constant(1, 5);
  return bending;
}

TEST(Bending, FoldsFromItsRestAngleAlsoPastPi) {
  for (double rest : {0.4, 3., -3.})
    for (double turn : {0.5, -0.7}) {
      const Bending bending = hinge_of_unequal_triangles(rest);
      const Matrix3Xd x = folded(rest + turn);
      EXPECT_NEAR(energy(bending, x), 5. / 2 * turn * turn, kRounding) << rest << " + " << turn;
      Matrix3Xd f = Matrix3Xd::Zero(3, 4);
      add_forces(bending, x, f);
      EXPECT_NEAR(f.col(2).norm(), 5 * std::abs(turn) / 3, kRounding);  // torque over the height
      EXPECT_NEAR(f.col(3).norm(), 5 * std::abs(turn) / 1, kRounding);
    }
}

TEST(Bending, CountsThreeQuartersOfTheAngleWhereATriangleHasHalfATenthOfItsArea) {
  for (int side : {0, 1}) {
    Bending bending = hinge_of_unequal_triangles(0);
    bending.area(side, 0) *= 20;
    const double counted = 0.5 * (2 - 0.5) * 0.6;
    EXPECT_NEAR(energy(bending, folded(0.6)), 5. / 2 * counted * counted, kRounding) << side;
  }
}

// The triangles press up on the edge's ends as levers: (1 - 0.15)/3 + (1 - 0.4) of the torque on the first.
TEST(Bending, MeanForceIsThatOnTheEndsOfEdgesAlone) {
  Bending bending = hinge_of_unequal_triangles(-0.5);
  const double first = (1 - 0.3 / 2) / 3 + (1 - 0.8 / 2), second = 0.3 / 2 / 3 + 0.8 / 2;
  const auto expect_torque = [&](double torque) {
    const Eigen::Vector4d expected(torque * first, torque * second, 0, 0);
    EXPECT_LT((mean_bending_forces(bending, folded(0)) - expected).norm(), kRounding);
  };
  expect_torque(5 * 0.5);
  bending.hinges.conservativeResize(4, 2);
  bending.hinges.col(1) << 1, 0, 3, 2;  // the same edge as seen from its other side
  bending.area.conservativeResize(2, 2);
  bending.area.col(1) << 1, 3;
  bending.rest_angle = Eigen::Vector2d(-0.5, 0.2);
  bending.stiffness = Eigen::Vector2d(5, 7);
  expect_torque((5 * 0.5 + 7 * 0.2) / 2);
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
}  // namespace testbed::massspring
