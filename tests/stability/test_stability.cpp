#include <gtest/gtest.h>

#include "tests/stability/stability.h"

namespace testbed::massspring {
namespace {

const Method& find_method(const std::string& name) {
  for (const Method& method : methods())
    if (method.name == name) return method;
  throw std::logic_error(name);
}

const Start& find_start(const std::string& name) {
  for (const Start& start : starts())
    if (start.name == name) return start;
  throw std::logic_error(name);
}

class Stability : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Ours, Stability,
                         testing::Values("minimising_definite_springs", "minimising_edge_coupled",
                                         "minimising_node_averaged"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(Stability, FromEveryStartStepsConvergeAndGainNoEnergy) {
  for (const Start& start : starts())
    for (const double h : {1e-3, 1e-1}) {
      constexpr double E = 1e5, kRounding = 1e-9;
      const Outcome outcome = run_cell(find_method(GetParam()), start, E, h);
      EXPECT_TRUE(outcome.name == "ok" || outcome.name == "short")
          << start.name << ' ' << h << ' ' << outcome.name;
      EXPECT_LE(outcome.energy_ratio, 1 + kRounding) << start.name << ' ' << h;
      EXPECT_GT(outcome.t, 0);
    }
}

// Nothing but a body's own inertia, a billionth of its stiffness, holds it from turning.
TEST(Stability, AStiffMirroredBodyTurnsBackInLongSteps) {
  for (const char* method : {"minimising_edge_coupled", "minimising_node_averaged"})
    for (const std::uint64_t seed : {1, 2}) {
      constexpr double E = 1e9, h = 1;
      const Outcome outcome = run_cell(find_method(method), find_start("mirrored"), E, h, seed);
      EXPECT_EQ(outcome.name, "ok") << method << ' ' << seed;
    }
}

// Bodies that buckle pass saddles, near which a Hessian kept positive is far too stiff.
TEST(Stability, AStiffBodyFromRandomPositionsComesPastItsSaddlesInLongSteps) {
  for (const double E : {1e7, 1e8}) {
    constexpr double h = 1;
    EXPECT_EQ(run_cell(find_method("minimising_node_averaged"), find_start("random"), E, h).name, "ok") << E;
  }
}

// The paper's network is a mechanism; stiff, it folds along valleys that bend too much for steps as long.
TEST(Stability, AStiffMechanismFoldsInHalvedSteps) {
  for (const char* start : {"crushed", "flattened"}) {
    constexpr double E = 1e9, h = 1;
    const Outcome outcome = run_cell(find_method("minimising_definite_springs"), find_start(start), E, h);
    EXPECT_EQ(outcome.name, "ok") << start;
  }
}

TEST(StabilityMap, TellsPatchesThatAreInsideOut) {
  // A millisecond in which nothing can turn: tetrahedra are what they were.
  for (const char* method : {"minimising_edge_coupled", "minimising_node_averaged"}) {
    EXPECT_NEAR(run_cell(find_method(method), find_start("squashed"), 1e3, 1e-4).least_patch, 0.5, 0.1);
    EXPECT_NEAR(run_cell(find_method(method), find_start("mirrored"), 1e3, 1e-4).least_patch, -1, 0.1);
  }
}

TEST(StabilityMap, TellsStableFromUnstableAndGainedEnergy) {
  // The body's stability limit is 4.4e-3 s.
  EXPECT_EQ(run_cell(find_method("symplectic_euler"), find_start("rest"), 1e4, 1e-3).name, "ok");
  EXPECT_EQ(run_cell(find_method("symplectic_euler"), find_start("rest"), 1e4, 1e-1).name, "diverged");
  EXPECT_EQ(run_cell(find_method("explicit_euler"), find_start("rest"), 1e4, 1e-3).name, "energy_gained");
  EXPECT_EQ(run_cell(find_method("explicit_euler"), find_start("mirrored"), 1e9, 1e-1).name, "diverged");
}

}  // namespace
}  // namespace testbed::massspring
