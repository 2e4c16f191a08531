// Vibrations and steps in time against exact motions of the discrete system.
#include <gtest/gtest.h>

#include <cmath>

#include "fem_reference/dynamics.h"
#include "fem_reference/elasticity.h"
#include "tests/massspring/box_tets.h"

namespace testbed {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

const Material kMaterial{1000, 0.3, 1, 0};

struct Bar {
  ElasticSolid solid{box_tets(4, 1, 1, 0.5, 0), 2};
  std::vector<int> held;
  Bar() {
    ElasticLoads gravity;
    gravity.body_force = [](const Vector3d&) { return Vector3d(0, -1, 0); };
    std::vector<HeldComponent> clamp;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3 && solid.X()(0, i) == 0; ++c) {
        clamp.push_back({i, c, 0});
        held.push_back(3 * i + c);
      }
    solid.assemble(kMaterial, ElasticLaw::SmallStrain, gravity, clamp);
  }
  LinearDynamics system() const {
    return {solid.stiffness(),
            solid.mass(),
            0,
            VectorXd::Zero(solid.n_dofs()),
            held,
            VectorXd::Zero(static_cast<Eigen::Index>(held.size()))};
  }
};

TEST(NaturalModes, SatisfyTheirEquation) {
  const Bar bar;
  const LinearDynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, s.held, 6);
  EXPECT_EQ(modes.n_rigid, 0);
  const Eigen::MatrixXd orthonormal = modes.shape.transpose() * s.M * modes.shape;
  EXPECT_LT((orthonormal - Eigen::MatrixXd::Identity(6, 6)).norm(), 1e-10);
  for (int k = 0; k < 6; ++k) {
    const double w = 2 * M_PI * modes.frequency(k);
    VectorXd residual = s.K * modes.shape.col(k) - w * w * (s.M * modes.shape.col(k));
    residual(s.held).setZero();
    EXPECT_LT(residual.norm(), 1e-7 * (s.K * modes.shape.col(k)).norm()) << k;
  }
}

TEST(NaturalModes, OfAFreeBodyBeginWithSixRigidMotions) {
  const Bar bar;
  const LinearDynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, {}, 8);
  EXPECT_EQ(modes.n_rigid, 6);
  EXPECT_EQ(modes.frequency(5), 0);
  EXPECT_GT(modes.frequency(6), 0);
}

/// Largest distance from the exact motion cos(w t) of the first mode over two periods.
double error_of(const Bar& bar, const TimeScheme& scheme, int steps_per_period) {
  const LinearDynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, s.held, 1);
  const double period = 1 / modes.frequency(0), h = period / steps_per_period;
  TimeIntegrator motion(s, h, scheme);
  motion.restart(modes.shape.col(0), VectorXd::Zero(modes.shape.rows()));
  double error = 0;
  for (int n = 1; n <= 2 * steps_per_period; ++n) {
    motion.step();
    const double exact = std::cos(2 * M_PI * n / steps_per_period);
    error = std::max(error, (motion.u() - exact * modes.shape.col(0)).norm() / modes.shape.col(0).norm());
  }
  return error;
}

TEST(TimeIntegrator, IsOfSecondOrder) {
  const Bar bar;
  for (const TimeScheme& scheme : {newmark, generalised_alpha(0.5)})
    EXPECT_NEAR(std::log2(error_of(bar, scheme, 40) / error_of(bar, scheme, 80)), 2, 0.1);
}

TEST(TimeIntegrator, NewmarkConservesEnergy) {
  constexpr double kDrift = 1e-10;
  const Bar bar;
  LinearDynamics s = bar.system();
  VectorXd start = VectorXd::Zero(bar.solid.n_dofs());
  for (int i = 0; i < bar.solid.X().cols(); ++i) start(3 * i + 1) = std::pow(bar.solid.X()(0, i), 2);
  TimeIntegrator motion(std::move(s), 0.01, newmark);
  motion.restart(VectorXd::Zero(start.size()), start);
  const double energy = motion.kinetic_energy();
  double least_kinetic = energy;
  for (int n = 0; n < 1000; ++n) {
    motion.step();
    EXPECT_NEAR(motion.kinetic_energy() + motion.elastic_energy(), energy, kDrift * energy);
    least_kinetic = std::min(least_kinetic, motion.kinetic_energy());
  }
  EXPECT_LT(least_kinetic, 0.1 * energy);  // it swung
}

TEST(TimeIntegrator, GeneralisedAlphaKillsTheHighestMotions) {
  const Bar bar;
  TimeIntegrator motion(bar.system(), 10, generalised_alpha(0));
  VectorXd start = VectorXd::Random(bar.solid.n_dofs());
  start(bar.held).setZero();
  motion.restart(start, VectorXd::Zero(start.size()));
  const double energy = motion.elastic_energy();
  for (int n = 0; n < 20; ++n) motion.step();
  EXPECT_LT(motion.kinetic_energy() + motion.elastic_energy(), 1e-3 * energy);
}

TEST(TimeIntegrator, DampedMotionEndsAtEquilibrium) {
  Bar bar;
  bar.solid.solve();
  LinearDynamics s = bar.system();
  s.load = bar.solid.load();
  const Modes modes = natural_modes(s.K, s.M, s.held, 1);
  s.damping = 4 * M_PI * modes.frequency(0);  // critical for the first mode
  TimeIntegrator motion(std::move(s), 0.02 / modes.frequency(0), newmark);
  for (int n = 0; n < 400; ++n) motion.step();
  const VectorXd rest = bar.solid.displacement().reshaped();
  EXPECT_LT((motion.u() - rest).norm(),
            1e-5 * rest.norm());  // what is left is of the highest modes, which long steps damp least
}

TEST(TimeIntegrator, MovesHeldUnknownsAtTheirVelocity) {
  const Bar bar;
  LinearDynamics s = bar.system();
  s.held_velocity.setConstant(0.3);
  TimeIntegrator motion(s, 0.05, newmark);
  for (int n = 0; n < 20; ++n) motion.step();
  EXPECT_LT((motion.u()(s.held).array() - 0.3).abs().maxCoeff(), 1e-12);
}

}  // namespace
}  // namespace testbed
