#include <gtest/gtest.h>

#include "fem_reference/richardson.h"
#include "meshing/shapes.h"

namespace testbed {
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
  EXPECT_GT(error.of_first, 0.08);
  EXPECT_LT(error.of_first, 0.2);
}

}  // namespace
}  // namespace testbed
