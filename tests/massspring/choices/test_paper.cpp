#include <gtest/gtest.h>

#include "massspring/choices/paper.h"

namespace testbed::massspring {
namespace {

TEST(PaperMethod, TakesPrecedenceOverWhatThePaperHasNot) {
  Scene scene;
  scene.is_paper = true;
  scene.time.integrator = "bdf2";
  scene.network.spring_law = SpringLaw::Definite;
  scene.network.link_share = 0.2;
  scene.collapse.emplace().least = 0.1;
  scene.time.tolerance = 1e-3;
  scene.time.sleep_below = 1e-3;
  scene.comparison.calibrations = {"affine"};
  Scene explicit_scene = scene;
  set_paper_method(scene);
  EXPECT_EQ(scene.time.integrator, "implicit_euler");
  EXPECT_EQ(scene.time.linear_solver, Krylov::BiCg);
  EXPECT_EQ(scene.time.tolerance, 0);
  EXPECT_EQ(scene.time.sleep_below, 0);
  EXPECT_EQ(scene.network.spring_law, SpringLaw::Hooke);
  EXPECT_EQ(scene.network.connectivity, "pcp");
  EXPECT_EQ(scene.network.calibration, "uniform");
  EXPECT_EQ(scene.network.link_share, 0);
  EXPECT_TRUE(scene.collapse->is_per_step);
  EXPECT_EQ(scene.collapse->least, 0);
  EXPECT_TRUE(scene.comparison.calibrations.empty());
  explicit_scene.time.integrator = "explicit_euler";
  set_paper_method(explicit_scene);
  EXPECT_EQ(explicit_scene.time.integrator, "explicit_euler");
}

}  // namespace
}  // namespace testbed::massspring
