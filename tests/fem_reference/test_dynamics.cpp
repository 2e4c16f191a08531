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

/// Largest distance from the exact motion of the first mode over two periods, damped to `damping` of what is
/// critical by mass and by stiffness alike.
double error_of(const Bar& bar, const TimeScheme& scheme, int steps_per_period, double damping) {
  LinearDynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, s.held, 1);
  const double w = 2 * M_PI * modes.frequency(0), damped = w * std::sqrt(1 - damping * damping);
  s.damping = damping * w;
  s.stiffness_damping = damping / w;
  TimeIntegrator motion(s, 2 * M_PI / w / steps_per_period, scheme);
  motion.restart(modes.shape.col(0), VectorXd::Zero(modes.shape.rows()));
  double error = 0;
  for (int n = 1; n <= 2 * steps_per_period; ++n) {
    motion.step();
    const double t = 2 * M_PI / w * n / steps_per_period;
    const double exact =
        std::exp(-damping * w * t) * (std::cos(damped * t) + damping * w / damped * std::sin(damped * t));
    error = std::max(error, (motion.u() - exact * modes.shape.col(0)).norm() / modes.shape.col(0).norm());
  }
  return error;
}

TEST(TimeIntegrator, IsOfSecondOrder) {
  const Bar bar;
  for (const TimeScheme& scheme : {newmark, generalised_alpha(0.5)})
    for (double damping : {0.0, 0.2}) {
      const double fine = error_of(bar, scheme, 80, damping);
      EXPECT_LT(fine, 0.02);
      EXPECT_NEAR(std::log2(error_of(bar, scheme, 40, damping) / fine), 2, 0.1);
    }
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

// Of motions much faster than the step, n steps leave rho^n, which a triple root makes (a + b n + c n^2)
// rho^n.
TEST(TimeIntegrator, GeneralisedAlphaDampsTheHighestMotionsAsItSays) {
  constexpr int kSteps = 20;
  const Bar bar;
  VectorXd start = VectorXd::Random(bar.solid.n_dofs());
  start(bar.held).setZero();
  const auto left_by_half = [&](const TimeScheme& scheme) {
    TimeIntegrator motion(bar.system(), 100, scheme);  // the slowest period is 1.6 s
    motion.restart(start, VectorXd::Zero(start.size()));
    for (int n = 0; n < kSteps; ++n) motion.step();
    const double before = motion.u().norm();
    for (int n = 0; n < kSteps; ++n) motion.step();
    return motion.u().norm() / before;
  };
  EXPECT_NEAR(left_by_half(newmark), 1, 0.01);
  for (double rho : {0.5, 0.8}) {
    const double left = left_by_half(generalised_alpha(rho));
    EXPECT_GE(left, 0.5 * std::pow(rho, kSteps));
    EXPECT_LE(left, 8 * std::pow(rho, kSteps));
  }
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

/// First frequency (Hz) along a free bar that cannot move sideways, over c / (2 L).
double frequency_along(int degree, MassMatrix kind, int n) {
  constexpr double L = 2;
  ElasticSolid solid(box_tets(n, n / 4, n / 4, L / n), degree);
  solid.assemble(kMaterial, ElasticLaw::SmallStrain, {}, {});
  std::vector<int> held;
  for (int k = 0; k < solid.n_dofs(); ++k)
    if (k % 3 != 0) held.push_back(k);
  const Eigen::SparseMatrix<double> M = solid.mass(kind);
  EXPECT_NEAR(M.sum(), 3 * kMaterial.rho * L / 4, 1e-12);
  EXPECT_EQ(M.nonZeros() == M.rows(), kind == MassMatrix::Lumped);
  EXPECT_GT(M.diagonal().minCoeff(), 0);
  const Modes modes = natural_modes(solid.stiffness(), M, held, 2);
  const double nu = kMaterial.nu, c2 = kMaterial.E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / kMaterial.rho;
  return modes.frequency(1) / (std::sqrt(c2) / (2 * L));
}

// No consistent mass makes a frequency too low [Rayleigh]. Lumped, both degrees are of second order.
TEST(NaturalModes, ALumpedMassLowersThem) {
  for (int degree : {1, 2}) {
    EXPECT_GT(frequency_along(degree, MassMatrix::Consistent, 4), 1);
    const int n = 8 / degree;
    const double coarse = frequency_along(degree, MassMatrix::Lumped, n) - 1,
                 fine = frequency_along(degree, MassMatrix::Lumped, 2 * n) - 1;
    EXPECT_LT(coarse, 0);
    EXPECT_NEAR(std::log2(coarse / fine), 2, 0.3);
  }
}

}  // namespace
}  // namespace testbed
