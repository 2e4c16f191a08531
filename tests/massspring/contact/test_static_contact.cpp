// Equilibria of springs that obstacles hold, with and without friction.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>

#include "massspring/calibrations/calibrate.h"
#include "massspring/contact/contact.h"
#include "massspring/statics/quasi_static.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using meshing::box_tets;

constexpr double kE = 1e6, kNu = 0.3;

Obstacle plate(double at, double normal, double moves, double friction = 0) {
  Obstacle obstacle;
  obstacle.shape = HalfSpace{{0, 0, at}, {0, 0, normal}};
  obstacle.motion = {{0, 0, 0, 0}, {1, 0, 0, moves}};
  obstacle.friction = friction;
  return obstacle;
}

/// A cube of 1 m that no support holds, among obstacles.
struct StaticCube {
  MassSpringModel model;
  Forces forces;
  Contacts contacts;
  State state;
  int n_iterations = 0;

  StaticCube(const std::string& calibration, const std::vector<Obstacle>& obstacles,
             const Vector3d& gravity) {
    const TetMesh mesh = box_tets(3, 3, 3, 1. / 3, 0);
    SpringNetwork network;
    network.X = mesh.X;
    network.F = mesh.F;
    network.T = mesh.T;
    network.n_surface = static_cast<int>(mesh.X.cols());
    model = calibrate(network, {kE, kNu, 1000, 0}, find_calibration(calibration));
    forces.load = gravity * model.mass.transpose();
    for (const Obstacle& obstacle : obstacles) contacts.bodies.emplace_back(obstacle);
    add_obstacles(contacts, model, forces);
    state = initial_state(model);
  }

  Status solve(int n_steps) {
    QuasiStaticSolver solver(model, forces);
    for (int n = 1; n <= n_steps; ++n) {
      const StepReport report = solver.solve(static_cast<double>(n) / n_steps, state);
      n_iterations += report.newton_iterations;
      state.t = static_cast<double>(n) / n_steps;
      if (report.status != Status::Ok) return report.status;
    }
    return Status::Ok;
  }
};

class StaticContactOf : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(, StaticContactOf, testing::Values("edge_coupled", "node_averaged"));

// Whatever the gaps at the plates, uniform pressure leaves one deformation gradient; across it there is no stress.
TEST_P(StaticContactOf, ACubePressedBetweenPlatesHasOneStress) {
  for (const double depth : {0.02, 0.2}) {
    StaticCube cube(GetParam(), {plate(0, 1, 0), plate(1, -1, -depth)}, Vector3d::Zero());
    ASSERT_EQ(cube.solve(10), Status::Ok);
    const Matrix3Xd& X = cube.model.network.X;
    const Eigen::Index n = X.cols();
    Eigen::MatrixXd rest(n, 4);
    rest << X.transpose(), Eigen::VectorXd::Ones(n);
    const Eigen::MatrixXd fit = rest.colPivHouseholderQr().solve(cube.state.x.transpose());
    const double deviation = (rest * fit - cube.state.x.transpose()).rowwise().norm().maxCoeff() / depth;
    EXPECT_LT(deviation, 3e-5);
    EXPECT_LT(cube.n_iterations, 80);
    const Eigen::Matrix3d F = fit.topRows<3>().transpose();
    EXPECT_NEAR(F(2, 2), 1 - depth, 2e-3);  // gaps are up to a range, 1.7e-3 m
    const double mu = kE / (2 * (1 + kNu)), lambda = 2 * mu * kNu / (1 - 2 * kNu), J = F.determinant();
    for (int k = 0; k < 2; ++k)
      EXPECT_NEAR(mu * F(k, k) + (lambda / 2 * (J * J - 1) - mu) / F(k, k), 0, 1e-5 * kE * depth);
  }
}

// Gravity on a floor, from above it or in touch with it.
TEST_P(StaticContactOf, ABodyFallsOntoTheFloorThatHoldsIt) {
  for (const double height : {0., 0.1}) {
    StaticCube cube(GetParam(), {plate(-height, 1, 0)}, {0, 0, -9.81});
    ASSERT_EQ(cube.solve(2), Status::Ok) << height;
    EXPECT_GT(cube.state.x.row(2).minCoeff(), -height);
    EXPECT_LT(cube.state.x.row(2).minCoeff(), -height + 2e-3);
    EXPECT_LT((cube.state.x - cube.model.network.X).topRows<2>().cwiseAbs().maxCoeff(), 0.01);
  }
}

// With gravity as a slope has it. Where friction cannot hold the body, there is no equilibrium near.
TEST_P(StaticContactOf, ABlockOnASlopeSticksUpToTheAngleOfFrictionAndNoFurther) {
  constexpr double kFriction = 0.5;
  for (const double height : {0., 0.01})
    for (const double part : {0.99, 1.01}) {
      const double angle = std::atan(part * kFriction);
      StaticCube cube(GetParam(), {plate(-height, 1, 0, kFriction)},
                      {9.81 * std::sin(angle), 0, -9.81 * std::cos(angle)});
      EXPECT_EQ(cube.solve(4), part < 1 ? Status::Ok : Status::NotConverged) << part;
      if (part > 1) continue;
      // It creeps by less than the slip up to which friction is smoothed, and shears by its own weight.
      EXPECT_LT((cube.state.x - cube.model.network.X).row(0).cwiseAbs().maxCoeff(), 0.03 + height);
    }
}

// Between plates with friction that sticks a cube barrels; without friction it does not.
TEST_P(StaticContactOf, FrictionHoldsTheFacesThatPlatesPress) {
  StaticCube cube(GetParam(), {plate(0, 1, 0, 10), plate(1, -1, -0.1, 10)}, Vector3d::Zero());
  ASSERT_EQ(cube.solve(10), Status::Ok);
  const Matrix3Xd &X = cube.model.network.X, u = cube.state.x - X;
  for (int i = 0; i < X.cols(); ++i)
    if (X(2, i) == 0 || X(2, i) == 1) {
      EXPECT_LT(u.col(i).head<2>().norm(), 3e-4) << i;
    }
  EXPECT_GT(u.row(0).maxCoeff(), 0.01);
}

}  // namespace
}  // namespace testbed::massspring
