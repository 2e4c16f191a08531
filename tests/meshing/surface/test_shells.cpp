#include <gtest/gtest.h>

#include "meshing/surface/shapes.h"
#include "meshing/surface/shells.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

TEST(Shells, NestedOnesKnowTheirParentAndDepth) {
  // a hollow ball with a solid ball in its cavity, and a ball beside it
  const SurfaceMesh ball = make_shape("ball", 162);
  const SurfaceMesh all =
      join(join(ball, inside_out(scaled(ball, 0.6))), join(scaled(ball, 0.3), shifted(ball, {3, 0, 0})));
  const std::vector<Shell> shells = shells_of(all);
  ASSERT_EQ(shells.size(), 4u);
  const int parents[] = {-1, 0, 1, -1}, depths[] = {0, 1, 2, 0};
  for (int s = 0; s < 4; ++s) {
    EXPECT_EQ(shells[s].parent, parents[s]);
    EXPECT_EQ(shells[s].depth, depths[s]);
    EXPECT_EQ(shells[s].triangles.size(), 320u);
    EXPECT_EQ(shells[s].volume > 0, s != 1);
  }
}

TEST(WindingNumber, IsOneInsideAndZeroOutside) {
  const SurfaceMesh torus = make_shape("torus", 400);
  constexpr double kRounding = 1e-12;
  EXPECT_NEAR(winding_number({1, 0, 0.1}, torus.X, torus.F), 1, kRounding);
  EXPECT_NEAR(winding_number({0, 0, 0}, torus.X, torus.F), 0, kRounding);
  EXPECT_NEAR(winding_number({1, 0, 0.5}, torus.X, torus.F), 0, kRounding);
}
