// Bodies that obstacles alone hold, in statics and in motion, on either degree.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>

#include "meshing/surface_energies/barrier.h"
#include "tests/fem_reference/dynamics_of.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using namespace meshing;

const Material kMaterial{1e6, 0.3, 1000, 0};

RigidBody plate(double at, double normal, double moves, double friction = 0) {
  Obstacle obstacle;
  obstacle.shape = HalfSpace{{0, 0, at}, {0, 0, normal}};
  obstacle.motion = {{0, 0, 0, 0}, {1, 0, 0, moves}};
  obstacle.friction = friction;
  return RigidBody(obstacle);
}

class AmongObstacles : public testing::TestWithParam<int> {
 protected:
  /// A cube of 1 m that no support holds.
  ElasticSolid cube(int n) const { return {box_tets(n, n, n, 1. / n), GetParam()}; }
  static ElasticLoads loads_of(const ElasticSolid& solid, const std::vector<RigidBody>& bodies,
                               const Vector3d& gravity) {
    ElasticLoads loads;
    loads.body_force = [f = Vector3d(kMaterial.rho * gravity)](const Vector3d&) { return f; };
    loads.surface = obstacles_in_statics(bodies, solid.X(), solid.faces(), kMaterial.E,
                                         std::vector<char>(solid.X().cols(), false));
    return loads;
  }
  static bool solve(ElasticSolid& solid, int n_steps) {
    for (int n = 1; n <= n_steps; ++n) {
      if (!solid.solve(static_cast<double>(n) / n_steps).is_converged) return false;
    }
    return true;
  }
};
INSTANTIATE_TEST_SUITE_P(Degrees, AmongObstacles, testing::Values(1, 2));

// Whatever the gaps at the plates, uniform pressure leaves one deformation gradient; across it there is no stress.
TEST_P(AmongObstacles, ACubePressedBetweenPlatesHasOneStress) {
  for (const double depth : {0.02, 0.2}) {
    ElasticSolid solid = cube(2);
    const Matrix3Xd X = solid.X();
    solid.assemble(kMaterial, ElasticLaw::NeoHookean,
                   loads_of(solid, {plate(0, 1, 0), plate(1, -1, -depth)}, Vector3d::Zero()), {});
    ASSERT_TRUE(solve(solid, 10));
    const Matrix3Xd x = X + solid.displacement();
    Eigen::MatrixXd rest(X.cols(), 4);
    rest << X.transpose(), VectorXd::Ones(X.cols());
    const Eigen::MatrixXd fit = rest.colPivHouseholderQr().solve(x.transpose());
    const double deviation = (rest * fit - x.transpose()).rowwise().norm().maxCoeff() / depth;
    EXPECT_LT(deviation, 7e-5);
    const Eigen::Matrix3d F = fit.topRows<3>().transpose();
    EXPECT_NEAR(F(2, 2), 1 - depth, 2e-3);  // gaps are up to a range, 1.7e-3 m
    const double mu = kMaterial.E / (2 * (1 + kMaterial.nu)),
                 lambda = 2 * mu * kMaterial.nu / (1 - 2 * kMaterial.nu), J = F.determinant();
    for (int k = 0; k < 2; ++k)
      EXPECT_NEAR(mu * F(k, k) + (lambda / 2 * (J * J - 1) - mu) / F(k, k), 0, 1e-5 * kMaterial.E * depth);
  }
}

// With gravity as a slope has it. Where friction cannot hold the body, there is no equilibrium near.
TEST_P(AmongObstacles, ABlockOnASlopeSticksUpToTheAngleOfFrictionAndNoFurther) {
  constexpr double kFriction = 0.5;
  for (const double part : {0.99, 1.01}) {
    const double angle = std::atan(part * kFriction);
    ElasticSolid solid = cube(2);
    solid.assemble(
        kMaterial, ElasticLaw::NeoHookean,
        loads_of(solid, {plate(0, 1, 0, kFriction)}, 9.81 * Vector3d(std::sin(angle), 0, -std::cos(angle))),
        {});
    EXPECT_EQ(solve(solid, 4), part < 1) << part;
    if (part < 1) {
      EXPECT_LT(solid.displacement().row(0).cwiseAbs().maxCoeff(), 0.03);
    }
  }
}

// Thrown at an angle onto a floor without friction it bounces, keeps its momentum along the floor and gains no
// energy.
TEST_P(AmongObstacles, AThrownCubeBouncesByStepsThatGainNoEnergy) {
  ElasticSolid solid = cube(2);
  const Matrix3Xd X = solid.X();
  ElasticLoads loads;
  loads.surface = {barrier_around({plate(-0.02, 1, 0)}, X, solid.faces(), kMaterial.E,
                                  std::vector<char>(X.cols(), false))};
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
  const Dynamics s = dynamics_of(solid);
  GeneralisedAlpha motion(s, 0.002, kImplicitEuler);
  const VectorXd start = Vector3d(0.5, 0, -0.3).replicate(1, X.cols()).reshaped();
  motion.restart(VectorXd::Zero(start.size()), start);
  const auto momentum = [&](int c) { return momentum_of(s, motion.v(), c); };
  const double along = momentum(0), down = momentum(2), first = motion.kinetic_energy();
  double energy = first, lowest = 1;
  for (int n = 0; n < 150; ++n) {
    ASSERT_TRUE(motion.step()) << n;
    lowest = std::min(lowest, (X + motion.u().reshaped(3, X.cols())).row(2).minCoeff());
    const double now = motion.kinetic_energy() + solid.energy(motion.u().reshaped(3, X.cols()));
    EXPECT_LT(now, energy + 1e-6 * first) << n;
    energy = now;
  }
  EXPECT_GT(lowest, -0.02);
  EXPECT_LT(lowest, -0.017) << "it came there";
  EXPECT_NEAR(momentum(0), along, 1e-7 * along);
  EXPECT_GT(momentum(2), -0.5 * down) << "and up again";
}

// A barrier is infinite at a gap of zero. What steps and frequencies know of the body at rest is free of it.
TEST_P(AmongObstacles, TheStiffnessOfACubeThatTouchesAFloorIsThatOfTheCubeAlone) {
  ElasticSolid alone = cube(2), touching = cube(2);
  ElasticLoads loads;
  loads.surface = obstacles_in_statics({plate(-1e-4, 1, 0)}, touching.X(), touching.faces(), kMaterial.E,
                                       std::vector<char>(touching.X().cols(), false));
  alone.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {});
  touching.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
  const Eigen::MatrixXd expected = alone.stiffness();
  EXPECT_TRUE(expected == Eigen::MatrixXd(touching.stiffness()));
  EXPECT_EQ(touching.surface().size(), 2);
}

}  // namespace
}  // namespace testbed::fem
