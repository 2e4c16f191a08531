#include <gtest/gtest.h>

#include <cmath>
#include <tuple>

#include "fem_reference/solid/richardson.h"
#include "meshing/surface/shapes.h"

namespace testbed::fem {
namespace {

/// Solutions whose error is a quarter of it with every refinement.
std::vector<Eigen::Matrix3Xd> second_order(const SurfaceMesh& surface, int n) {
  std::vector<Eigen::Matrix3Xd> u;
  for (int level = 0; level < n; ++level)
    u.push_back(surface.X + 0.08 * std::pow(0.25, level) * surface.X.colwise().reverse());
  return u;
}

TEST(Richardson, FindsRatioAndErrorFromThreeSolutions) {
  const SurfaceMesh ball = make_shape("ball", 162);
  const RefinementError error = richardson(second_order(ball, 3), ball);
  EXPECT_TRUE(error.is_ratio_observed);
  EXPECT_NEAR(error.ratio, 4, 1e-10);
  EXPECT_NEAR(error.of_first, 0.08, 1e-10);  // a ball: x mirrored in its components has x's norm
  EXPECT_NEAR(error.of_last, 0.005, 1e-10);
}

TEST(Richardson, ErrsToTheCautiousSideFromTwoSolutions) {
  const SurfaceMesh ball = make_shape("ball", 162);
  const RefinementError error = richardson(second_order(ball, 2), ball);
  EXPECT_FALSE(error.is_ratio_observed);
  EXPECT_EQ(error.ratio, 2);  // first order, slower than theirs
  EXPECT_GT(error.of_first, 0.08);
  EXPECT_NEAR(error.of_first, 2 * error.of_last, 1e-12);
  // The limit is x - 0.04 y of the mirrored y, and |x - 0.04 y| is within 4 % of |x|.
  EXPECT_NEAR(error.of_first, 0.12, 0.04 * 0.12);
}

TEST(Richardson, TakesNoRatioBeyondWhatElementsCanHave) {
  const SurfaceMesh ball = make_shape("ball", 162);
  const auto with_ratio = [&](double ratio) {
    std::vector<Eigen::Matrix3Xd> u;
    for (int level = 0; level < 3; ++level) u.push_back((1 + 0.01 * std::pow(ratio, -level)) * ball.X);
    return richardson(u, ball);
  };
  for (const auto& [ratio, taken] : {std::pair(1.1, 1.3), {1.0 / 3, 1.3}, {5.0, 5.0}, {20.0, 8.0}}) {
    const RefinementError error = with_ratio(ratio);
    EXPECT_NEAR(error.ratio, taken, 1e-9) << ratio;
    const double finest = 1 + 0.01 / (ratio * ratio), last_change = 0.01 / (ratio * ratio) - 0.01 / ratio,
                 limit = finest + last_change / (taken - 1);
    EXPECT_NEAR(error.of_last, std::abs(finest - limit) / limit, 1e-10) << ratio;
    EXPECT_NEAR(error.of_first, std::abs(1.01 - limit) / limit, 1e-10) << ratio;
  }
}

TEST(Richardson, ABodyThatStaysAtRestHasNoError) {
  const SurfaceMesh ball = make_shape("ball", 162);
  for (size_t n : {2, 3}) {
    const std::vector<Eigen::Matrix3Xd> u(n, Eigen::Matrix3Xd::Zero(3, ball.X.cols()));
    const RefinementError error = richardson(u, ball);
    EXPECT_EQ(error.of_first, 0);
    EXPECT_EQ(error.of_last, 0);
  }
}

}  // namespace
}  // namespace testbed::fem
