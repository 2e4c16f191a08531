#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "meshing/surface_energies/volume_penalty.h"
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
  VolumePenalty penalty{30, {F}, 0.4};
  Matrix3Xd forces(const Matrix3Xd& at) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, 5);
    penalty.add_forces(at, f);
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
    const double slope = (penalty.energy(up) - penalty.energy(down)) / (2 * kDifferenceStep);
    EXPECT_NEAR(f(k), -slope, kDifferenceTolerance * f.norm());
  }
}

TEST_F(VolumeForce, OfNoFacesIsNone) {
  const VolumePenalty none{30, {}, 0.4};
  Matrix3Xd f = Matrix3Xd::Zero(3, 5);
  none.add_forces(x, f);
  EXPECT_TRUE(f.isZero(0));
  SurfaceHessian H;
  none.add_hessian(x, H, Curvature::Exact);
  EXPECT_EQ(H.roots[0].cols(), 0);
  EXPECT_TRUE(H.curvatures.empty());
}

TEST_F(VolumeForce, RankOneTermIsTheWholeHessianAtTheTarget) {
  penalty.set_target(volume(x, F));
  SurfaceHessian H;
  penalty.add_hessian(x, H, Curvature::Projected);
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x, unit = Matrix3Xd::Zero(3, 5), column = unit;
    up(k) += kDifferenceStep;
    down(k) -= kDifferenceStep;
    unit(k) = 1;
    H.add_product(unit, column);
    EXPECT_GT(column.norm() + k, 0.1);
    const Matrix3Xd difference = (forces(down) - forces(up)) / (2 * kDifferenceStep);
    EXPECT_LT((column - difference).norm(), kDifferenceTolerance * H.roots[0].squaredNorm());
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

TEST_F(VolumeForce, HasTheTargetAtTheEndOfAStep) {
  const double at_rest = volume(model.network.X, F), V = volume(x, F);
  const auto energy_to = [&](double target) { return 15 * (V - target) * (V - target) / target; };
  VolumePenalty curved{30, {F}, TargetVolume{at_rest, {{0, 1}, {1, 2}}, true}};
  EXPECT_NEAR(curved.energy(x), energy_to(at_rest), kRounding);
  curved.begin_step(0.25, 0.5, x);
  EXPECT_NEAR(curved.energy(x), energy_to(1.75 * at_rest), kRounding);
  VolumePenalty steady{30, {F}, TargetVolume{at_rest, {}, false}},
      collapsing{30, {F}, TargetVolume{at_rest, {}, true}};
  steady.begin_step(0.25, 0.5, x);
  EXPECT_NEAR(steady.energy(x), energy_to(at_rest), kRounding);
  collapsing.begin_step(0.25, 0.5, x);
  EXPECT_NEAR(collapsing.energy(x), 0, kRounding);
}

TEST_F(VolumeForce, KeepsLinearAndAngularMomentum) {
  const Matrix3Xd f = forces(x);
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();
  for (int i = 0; i < 5; ++i) torque += x.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), kRounding * f.norm());
  EXPECT_LT(torque.norm(), kRounding * f.norm());
}

// Of a body that resists in proportion, whatever its stiffness: its minima are scaled copies of it.
TEST_F(VolumeForce, IsFoundWhereItIsHeldThatBalancesABodysOwn) {
  constexpr double kPart = 1e-9, kTarget = 1.1;
  const Matrix3Xd X = model.network.X;
  const double at_rest = volume(X, F);
  for (const double stiffness : {1e-2, 30., 3e4, -10.}) {
    HeldVolume held{30, {F}, TargetVolume{at_rest, {{0, 1}, {1, kTarget}}, false}};
    held.begin_step(0, 1, X);
    Matrix3Xd minimum = X;
    int n = 0;
    const NewtonReport report = minimise_constrained(
        {std::make_shared<HeldVolume>(held)}, [] { return NewtonReport{}; },
        [&]() -> const Matrix3Xd& { return X; });
    EXPECT_EQ(report.status, Status::NotConverged) << "a body that does not move";
    bool is_renewed = true;
    for (; is_renewed && n < 10; ++n) {
      // The pressure falls with the volume by 30 over the target, from what it is at rest.
      Matrix3Xd f = Matrix3Xd::Zero(3, 5), gradient;
      held.add_forces(X, f);
      volume_and_gradient(F, X, gradient);
      const double pressure =
                       f.leftCols(gradient.cols()).cwiseProduct(gradient).sum() / gradient.squaredNorm(),
                   grown = pressure / (stiffness + 30 / kTarget);
      minimum = std::cbrt(1 + grown) * X;
      is_renewed = held.renew(minimum);
    }
    EXPECT_LE(n, 4) << stiffness;
    EXPECT_NEAR(volume(minimum, F), kTarget * at_rest, 2 * kPart * at_rest) << stiffness;
    EXPECT_NEAR(*held.holding_pressure(), stiffness * (kTarget - 1), 1e-6 * std::abs(stiffness));
    EXPECT_EQ(held.stored(minimum), 0);
    EXPECT_NEAR(held.work(minimum), stiffness * 0.1 * 0.1 * at_rest, 1e-6 * std::abs(stiffness) * at_rest);
  }
}

/// The faces of a ball whose middles lie on the sphere, or straight ones.
Eigen::MatrixXi ball_faces(int n, Matrix3Xd& x) {
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
  return faces;
}

/// Under a pressure of 40 at half its strength, in a bag, and with a volume that is held by a pressure besides.
SurfaceEnergies on_a_ball(int n, Matrix3Xd& x) {
  const Eigen::MatrixXi faces = ball_faces(n, x);
  SurfaceEnergies energies = followers_of(Eigen::VectorXd::Constant(faces.cols(), 40.), faces);
  EXPECT_EQ(energies.size(), 1u);
  energies[0]->set_load_factor(0.5);
  energies.push_back(
      std::make_shared<VolumePenalty>(30, faces_of(faces), 0.9 * volume_of(faces_of(faces), x)));
  const auto held = std::make_shared<HeldVolume>(
      30, faces_of(faces), TargetVolume{volume_of(faces_of(faces), x), {{0, 1}, {1, 1.2}}, false});
  held->begin_step(0, 1, x);
  EXPECT_TRUE(held->renew(x));
  energies.push_back(held);
  return energies;
}

TEST(EnergiesOfVolume, ForcesAndHessianAreDifferencesOnStraightAndCurvedTriangles) {
  for (const int n : {3, 6}) {
    Matrix3Xd x;
    for (const auto& energy : on_a_ball(n, x)) {
      const int n_nodes = static_cast<int>(x.cols());
      const Matrix3Xd p = random_points(n_nodes, 1, 6);
      const auto forces = [&](const Matrix3Xd& at) {
        Matrix3Xd f = Matrix3Xd::Zero(3, n_nodes);
        energy->add_forces(at, f);
        return f;
      };
      const Matrix3Xd up = x + kDifferenceStep * p, down = x - kDifferenceStep * p, f = forces(x);
      ASSERT_GT(f.norm(), 0.1);
      EXPECT_NEAR(f.cwiseProduct(p).sum(),
                  (energy->energy(down) - energy->energy(up)) / (2 * kDifferenceStep),
                  kDifferenceTolerance * f.norm() * p.norm());
      SurfaceHessian H;
      energy->add_hessian(x, H, Curvature::Exact);
      Matrix3Xd Kp = Matrix3Xd::Zero(3, n_nodes), by_block = Kp;
      H.add_product(p, Kp);
      ASSERT_GT(Kp.norm(), 0.1);
      EXPECT_LT((Kp - (forces(down) - forces(up)) / (2 * kDifferenceStep)).norm(),
                kDifferenceTolerance * Kp.norm());
      SurfaceHessian but_angles;
      energy->add_hessian(x, but_angles, Curvature::ExactButAngles);
      Matrix3Xd same = Matrix3Xd::Zero(3, n_nodes);
      but_angles.add_product(p, same);
      EXPECT_EQ(same, Kp);
      H.for_each_block([&](int i, int j, const Eigen::Matrix3d& block) {
        by_block.col(i) += block * p.col(j);
        if (i != j) by_block.col(j) += block.transpose() * p.col(i);
      });
      for (const Matrix3Xd& g : H.roots) by_block += g.cwiseProduct(p).sum() * g;
      EXPECT_LT((by_block - Kp).norm(), kRounding * 10 * Kp.norm());
    }
  }
}

// Curved triangles on the sphere have its volume to a power of the edge that straight ones have not.
TEST(FollowerPressure, OfACurvedBallIsThatOfTheSphere) {
  Matrix3Xd x;
  const double V = 4 * M_PI / 3 * std::pow(make_shape("ball", 42).X.col(0).norm(), 3);
  EXPECT_NEAR(on_a_ball(6, x)[0]->energy(x) / 20, V, 0.01 * V);
  EXPECT_LT(on_a_ball(3, x)[0]->energy(x) / 20, 0.95 * V);
}

}  // namespace
}  // namespace testbed::massspring
