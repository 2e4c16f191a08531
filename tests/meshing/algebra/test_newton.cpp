#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "meshing/algebra/newton.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kTolerance = 1e-10;

/// A function of the number x.
struct OfOneNumber {
  double x;
  double (*value)(double), (*slope)(double), (*curvature)(double);
  bool is_exact = true;
  double before = x;
  int n_moves = 0;

  NewtonReport minimise(const NewtonOptions& options) {
    Objective f;
    f.value = [this] { return value(x); };
    f.negative_gradient = [this](Matrix3Xd& r) { r = Eigen::Vector3d(-slope(x), 0, 0); };
    f.direction = [this](const Matrix3Xd& r, Matrix3Xd& dx) {
      dx = r / curvature(x);
      return is_exact;
    };
    f.move = [this](const Matrix3Xd& dx, double step) {
      x = before + step * dx(0);
      ++n_moves;
    };
    f.accept = [this] { before = x; };
    return meshing::minimise(f, options);
  }
};

double one(double) {
  return 1;
}

// Full steps would leap to and fro ever farther from |x| > 1.1.
TEST(Newton, BacktracksWhereFullStepsWouldDiverge) {
  OfOneNumber f{5, [](double x) { return std::log(std::cosh(x)); }, [](double x) { return std::tanh(x); },
                [](double x) { return 1 - std::tanh(x) * std::tanh(x); }};
  const NewtonReport report = f.minimise({50, 1, kTolerance});
  EXPECT_EQ(report.status, Status::Ok);
  EXPECT_LT(std::abs(f.x), kTolerance);
  EXPECT_GT(f.n_moves, report.iterations);
}

// The value rises by 4e-12 on the way to where its gradient, of the order of its rounding, is 0.
TEST(Newton, FollowsTheGradientWhereValuesAreFlatToRounding) {
  OfOneNumber f{-1, [](double x) { return 1 + 1e-12 * x; }, [](double x) { return 2e-20 * (x - 3); },
                [](double) { return 2e-20; }};
  EXPECT_EQ(f.minimise({50, 0, kTolerance}).status, Status::Ok);
  EXPECT_NEAR(f.x, 3, kTolerance);
}

TEST(Newton, GoesBeyondAFullStepWhereTheHessianIsTooStiffAndThatIsAllowed) {
  const auto parabola = [](double x) { return (x - 100) * (x - 100) / 128; };
  for (const bool may_extend : {false, true})
    for (const bool is_exact : {false, true}) {
      OfOneNumber f{0, parabola, [](double x) { return (x - 100) / 64; }, one, is_exact};
      const NewtonReport report = f.minimise({2000, 1, kTolerance, may_extend});
      EXPECT_EQ(report.status, Status::Ok);
      EXPECT_NEAR(f.x, 100, 100 * kTolerance);
      EXPECT_EQ(report.iterations < 100, may_extend && !is_exact) << report.iterations;
    }
}

TEST(Newton, TakesNoLongerStepThanItMay) {
  Matrix3Xd x = Eigen::Vector3d(8, 0, 0), before = x;
  double longest = 0;
  Objective f;
  f.value = [&] { return x.squaredNorm() / 2; };
  f.negative_gradient = [&](Matrix3Xd& r) { r = -x; };
  f.direction = [](const Matrix3Xd& r, Matrix3Xd& dx) {
    dx = r;
    return true;
  };
  f.largest_step = [](const Matrix3Xd&) { return 0.25; };
  f.move = [&](const Matrix3Xd& dx, double step) {
    longest = std::max(longest, step);
    x = before + step * dx;
  };
  f.accept = [&] { before = x; };
  EXPECT_EQ(minimise(f, {200, 1, kTolerance}).status, Status::Ok);
  EXPECT_EQ(longest, 0.25);
}

TEST(Newton, SaysWhyItFindsNoMinimumAndStaysWhereItLastDescended) {
  OfOneNumber nothing{std::numeric_limits<double>::quiet_NaN(), one, [](double x) { return x; }, one};
  EXPECT_EQ(nothing.minimise({50, 1}).status, Status::Diverged);

  OfOneNumber endless{0, [](double x) { return -x; }, [](double) { return -1.; }, one};
  NewtonReport report = endless.minimise({7, 1});
  EXPECT_EQ(report.status, Status::NotConverged);
  EXPECT_EQ(report.iterations, 7);
  EXPECT_EQ(report.reason, "7 Newton iterations found no minimum");
  EXPECT_EQ(endless.x, 7);

  OfOneNumber upward{1, [](double x) { return -x; }, [](double) { return 1.; }, one};  // the slope is wrong
  report = upward.minimise({50, 0});
  EXPECT_EQ(report.status, Status::NotConverged);
  EXPECT_EQ(report.reason, "no step along Newton's direction descends");
  EXPECT_EQ(upward.x, 1);
}

}  // namespace
}  // namespace testbed::massspring
