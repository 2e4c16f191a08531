#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <set>

#include "massspring/integrators.h"
#include "massspring/self_contact.h"
#include "meshing/shapes.h"
#include "tests/massspring/small_network.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/// Two balls beside each other, slightly off the axis.
MassSpringModel two_balls(double gap) {
  const SurfaceMesh ball = make_shape("ball", 42);
  const int n = static_cast<int>(ball.X.cols());
  const double radius = ball.X.colwise().norm().maxCoeff();
  MassSpringModel model;
  model.network.X.resize(3, 2 * n);
  model.network.X << ball.X, ball.X.colwise() + Vector3d(2 * radius + gap, 0.05, 0.03);
  model.network.F.resize(3, 2 * ball.F.cols());
  model.network.F << ball.F, ball.F.array() + n;
  model.network.n_surface = 2 * n;
  model.material.E = 1e3;
  model.mass = Eigen::VectorXd::Ones(2 * n);
  return model;
}

class TwoBalls : public testing::Test {
 protected:
  const double thickness = 0.05;
  const MassSpringModel model = two_balls(0.3);
  const int n = model.network.n_surface / 2;
  SurfaceContact contact{model, thickness};

  Matrix3Xd moved(double by) const {
    Matrix3Xd x = model.network.X;
    x.rightCols(n).row(0).array() -= by;
    return x;
  }
  Matrix3Xd forces(const Matrix3Xd& x) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, x.cols());
    contact.add_forces(x, f);
    return f;
  }
};

TEST_F(TwoBalls, PushEachOtherApartAlsoWhereTheyHavePassedThrough) {
  contact.begin_step(model.network.X);
  EXPECT_EQ(forces(model.network.X).norm(), 0) << "apart";
  for (double by = 0; by < 0.32; by += 0.02) contact.begin_step(moved(by));
  for (const double by : {0.33, 0.36, 0.4, 0.45}) {
    const Matrix3Xd f = forces(moved(by));
    EXPECT_GT(f.rightCols(n).row(0).sum(), 1) << by;
    EXPECT_LT(f.leftCols(n).row(0).sum(), -1) << by;
  }
}

TEST_F(TwoBalls, ForceIsMinusEnergyGradientAndKeepsMomentum) {
  for (double by = 0; by < 0.34; by += 0.02) contact.begin_step(moved(by));
  const Matrix3Xd x = moved(0.34) + random_points(2 * n, 2e-3, 7), f = forces(x);
  ASSERT_GT(f.norm(), 1);
  constexpr double kStep = 1e-7;
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x;
    up(k) += kStep;
    down(k) -= kStep;
    EXPECT_NEAR(f(k), -(contact.energy(up) - contact.energy(down)) / (2 * kStep), 1e-5 * f.norm());
  }
  Vector3d torque = Vector3d::Zero();
  for (int i = 0; i < x.cols(); ++i) torque += x.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), 1e-12 * f.norm());
  EXPECT_LT(torque.norm(), 1e-12 * f.norm());
}

TEST_F(TwoBalls, PotentialOfAMotionHasAllItsUndampedForcesAsNegativeGradient) {
  Forces all = no_forces(model);
  all.load = random_points(2 * n, 3, 8);
  all.volume_pressure = 20;
  all.followers.push_back({4, model.network.F});
  all.self_thickness = thickness;
  Motion motion(model, all);
  for (double by = 0; by < 0.34; by += 0.02) motion.self_contact->begin_step(moved(by));
  State state = initial_state(model);
  state.x = moved(0.34);
  Matrix3Xd f;
  motion.undamped_forces_at(state, f);
  Matrix3Xd by_contact = Matrix3Xd::Zero(3, 2 * n);
  motion.self_contact->add_forces(state.x, by_contact);
  ASSERT_GT(by_contact.norm(), 0.1 * f.norm());
  constexpr double kStep = 1e-7;
  for (int k = 0; k < f.size(); ++k) {
    State up = state, down = state;
    up.x(k) += kStep;
    down.x(k) -= kStep;
    EXPECT_NEAR(f(k), -(motion.potential(up) - motion.potential(down)) / (2 * kStep), 1e-5 * f.norm());
  }
}

TEST_F(TwoBalls, PairsAreThoseOfABruteForceSearch) {
  for (double by = 0; by < 0.3; by += 0.02) contact.begin_step(moved(by));
  const Matrix3Xd x = moved(0.31);
  contact.begin_step(x);
  std::set<std::pair<int, int>> found;  // vertices of one ball against nodes of the other's triangles
  for (const NearPair& pair : contact.touching(x))
    if (pair.weight[0] == 1) found.insert({pair.node[0], pair.node[1] + pair.node[2] + pair.node[3]});
  int n_expected = 0;
  for (int v = 0; v < 2 * n; ++v)
    for (const auto& t : model.network.F.colwise()) {
      if ((t(0) < n) == (v < n)) continue;
      double nearest = 1e9;  // by samples of the triangle
      for (int i = 0; i <= 60; ++i)
        for (int j = 0; i + j <= 60; ++j)
          nearest = std::min(
              nearest,
              (x.col(v) - (x.col(t(0)) * (60 - i - j) + x.col(t(1)) * i + x.col(t(2)) * j) / 60).norm());
      if (nearest > thickness) continue;
      ++n_expected;
      EXPECT_TRUE(found.count({v, t.sum()})) << v;
    }
  EXPECT_GT(n_expected, 0);
}

TEST_F(TwoBalls, BounceInsteadOfPassingThrough) {
  for (const Integrator integrator :
       {Integrator::SymplecticEuler, Integrator::ImplicitEuler, Integrator::MinimisingEuler}) {
    MassSpringModel body = model;
    body.network.E = Eigen::Matrix2Xi(2, 2 * n * (n - 1) / 2);
    int s = 0;
    for (int ball = 0; ball < 2; ++ball)
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < i; ++j) body.network.E.col(s++) << ball * n + i, ball * n + j;
    body.springs = Springs{body.network.E, Eigen::VectorXd::Constant(s, 200.0)};
    body.mass.setConstant(0.02);  // light enough for the penalty to stop it within the thickness
    Forces forces = no_forces(body);
    forces.self_thickness = thickness;
    State state = initial_state(body);
    state.v.rightCols(n).row(0).setConstant(-1);
    TimeStepper stepper(body, forces, integrator, 2);
    while (state.t < 2) ASSERT_EQ(stepper.step(state, 2e-3).status, Status::Ok);
    const double left = state.x.leftCols(n).row(0).mean(), right = state.x.rightCols(n).row(0).mean();
    EXPECT_GT(right - left, 2) << "passed through";
    EXPECT_LT(state.v.leftCols(n).row(0).mean(), -0.3) << "momentum not handed on";
    EXPECT_NEAR(state.v.row(0).mean(), -0.5, 1e-6) << "momentum not kept";
  }
}

}  // namespace
}  // namespace testbed
