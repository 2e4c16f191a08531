// Steps in which Newton's method does not end, of a single node on a spring that stiffens.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "fem_reference/solid/dynamics.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::VectorXd;

/// Tells when the step at hand begins, and how long it is. It works at 1 W.
struct StepAtHand : meshing::SurfaceEnergy {
  double t = 0, h = 0;
  void begin_step(double time, double length, const Matrix3Xd&) override {
    t = time;
    h = length;
  }
  double energy(const Matrix3Xd&) const override { return 0; }
  double work(const Matrix3Xd&) const override { return h; }
  void add_forces(const Matrix3Xd&, Matrix3Xd&) const override {}
  void add_hessian(const Matrix3Xd&, meshing::SurfaceHessian&, meshing::Curvature) const override {}
};

Eigen::SparseMatrix<double> diagonal(const VectorXd& d) {
  return Eigen::SparseMatrix<double>(Eigen::MatrixXd(d.asDiagonal()).sparseView());
}

/// f = 4 u + u^3 in each direction, and c (1, 1, 1) (1, 1, 1) u. The first direction is driven. Steps longer than
/// `longest`, or that begin after `last`, find no force.
Dynamics spring(double longest, double c = 0, double last = std::numeric_limits<double>::infinity()) {
  const auto step = std::make_shared<StepAtHand>();
  Dynamics s{
      diagonal(VectorXd::Constant(3, 4)), diagonal(VectorXd::Ones(3)), 0, 0, VectorXd::Zero(3), {0}, {}, {}};
  s.constrained_motion = [](double t) { return VectorXd::Constant(1, 0.1 * std::sin(3 * t)); };
  s.linearise = [=](const VectorXd& u, bool with_tangent) {
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    Linearisation at;
    const double sum = u.sum();
    at.force =
        (4 * u.array() + u.array().cube() + c * sum) * (step->h > longest || step->t > last ? kNone : 1);
    at.energy = (2 * u.array().square() + u.array().pow(4) / 4).sum() + c / 2 * sum * sum;
    if (with_tangent) {
      at.tangent = diagonal(4 + 3 * u.array().square());
      if (c > 0) at.roots.push_back(VectorXd::Constant(3, std::sqrt(c)));
    }
    return at;
  };
  s.X = Matrix3Xd::Ones(3, 1);
  s.surface = {step};
  return s;
}

constexpr double kStep = 0.1, kAny = 1, kSolved = 1e-8;

TEST(HalvedSteps, AreThoseOfHalfTheLengthAndCountOnce) {
  for (const int n_parts : {2, 4}) {
    GeneralisedAlpha halved(spring(1.01 * kStep / n_parts), kStep, kNewmark),
        shorter(spring(kAny), kStep / n_parts, kNewmark);
    const VectorXd start = Eigen::Vector3d(0, 1, -2);
    halved.restart(VectorXd::Zero(3), start);
    shorter.restart(VectorXd::Zero(3), start);
    for (int n = 1; n <= 5; ++n) {
      ASSERT_TRUE(halved.advance());
      EXPECT_NEAR(halved.ledger().flows.targets, n * kStep, 1e-14) << "of all parts";
      for (int part = 0; part < n_parts; ++part) ASSERT_TRUE(shorter.step());
      EXPECT_NEAR(halved.t(), n * kStep, 1e-14);
      EXPECT_LT((halved.u() - shorter.u()).norm(), kSolved) << n_parts << ' ' << n;
      EXPECT_LT((halved.v() - shorter.v()).norm(), kSolved) << n_parts << ' ' << n;
    }
    EXPECT_EQ(halved.counts().halved, 5);
    EXPECT_EQ(shorter.counts().halved, 0);
  }
}

TEST(HalvedSteps, EndAtA64th) {
  const VectorXd start = Eigen::Vector3d(0, 1, -2);
  for (const auto& [part, is_found] : {std::pair(1.01, true), std::pair(0.99, false)}) {
    GeneralisedAlpha motion(spring(part / 64 * kStep), kStep, kNewmark);
    motion.restart(VectorXd::Zero(3), start);
    EXPECT_EQ(motion.step(), is_found);
  }
}

TEST(HalvedSteps, LeaveTheStateAsItWasWhereTheSecondHalfFindsNone) {
  GeneralisedAlpha motion(spring(1.01 / 2 * kStep, 0, kStep / 4), kStep, kNewmark);
  motion.restart(VectorXd::Zero(3), Eigen::Vector3d(0, 1, -2));
  const MotionState before = motion.state();
  EXPECT_FALSE(motion.step());
  EXPECT_EQ(motion.t(), 0);
  EXPECT_EQ(motion.u(), before.u);
  EXPECT_EQ(motion.v(), before.v);
}

// What a tangent leaves out has as many entries as are free.
TEST(GeneralisedAlpha, GoesOnWhereASupportEndsWithATangentThatLeavesOutARoot) {
  const auto held = [](const std::vector<int>& constrained) {
    Dynamics s = spring(kAny, 1e5);
    s.constrained = constrained;
    s.constrained_motion = {};
    return s;
  };
  GeneralisedAlpha motion(held({0}), kStep, kNewmark), free(held({}), kStep, kNewmark);
  motion.restart(VectorXd::Zero(3), Eigen::Vector3d(0, 1, -2));
  for (int n = 0; n < 5; ++n) ASSERT_TRUE(motion.step());
  motion.hold({}, {});
  free.restart(motion.u(), motion.v());
  for (int n = 0; n < 5; ++n) {
    ASSERT_TRUE(motion.step());
    ASSERT_TRUE(free.step());
  }
  EXPECT_EQ(motion.u(), free.u()) << "nothing is kept of the tangents before";
}

}  // namespace
}  // namespace testbed::fem
