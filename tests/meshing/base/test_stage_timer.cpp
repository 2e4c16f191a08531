#include <gtest/gtest.h>

#include <thread>

#include "meshing/base/stage_timer.h"

namespace testbed::meshing {
namespace {

TEST(StageTimer, AddsUpStagesThatRunTwice) {
  constexpr double kPause = 0.01;  // s; a sleep may last longer, never shorter
  StageTimer timer;
  for (const char* stage : {"solve", "output", "solve"}) {
    timer.start(stage);
    std::this_thread::sleep_for(std::chrono::duration<double>(kPause));
  }
  timer.stop();
  const auto seconds = timer.seconds();
  ASSERT_EQ(seconds.size(), 2u);
  EXPECT_EQ(seconds[0].first, "solve") << "in the order in which they first ran";
  EXPECT_GE(seconds[0].second, 2 * kPause);
  EXPECT_EQ(seconds[1].first, "output");
  EXPECT_GE(seconds[1].second, kPause);
}

TEST(StageTimer, AddsWhatWasMeasuredOtherwise) {
  StageTimer timer;
  timer.add("start-up", 0.25);
  timer.add("mesh", 1);
  timer.add("start-up", 0.5);
  const std::vector<std::pair<std::string, double>> expected{{"start-up", 0.75}, {"mesh", 1}};
  EXPECT_EQ(timer.seconds(), expected);
}

}  // namespace
}  // namespace testbed::meshing
