// What may change in a run, and the steps that are left of it.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "meshing/scene/changed_keys.h"

namespace testbed::meshing {
namespace {

/// A scene with a value of each kind, under other ones where they are given.
Scene scene_with(const std::vector<std::string>& overrides) {
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "test_changed_keys.toml";
  std::ofstream(file) << R"(
gravity = [0, -9.81, 0]
material = { E = 1e5, law = "neo_hookean" }
surface = { shape = "ball" }
collapse = { coefficient = 0.5, pivots = [{ point = [0, 0, 0] }] }
volume = { coefficient = 10 }
skin = { stiffness = 10 }
self_contact = { on = true }
time = { mode = "dynamic", step = 0.01 }
[[supports]]
region = { plane = { point = [0, 0, 0], normal = [0, 1, 0] } }
[[loads]]
pressure = 5
[[loads]]
traction = [1, 0, 0]
[[obstacles]]
plane = { point = [0, -2, 0], normal = [0, 1, 0] }
)";
  return read_scene(file, overrides);
}

std::string refusal_of(const std::string& override) {
  try {
    changed_keys(scene_with({}), scene_with({override}));
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(ChangedKeys, AreNamedOnceEach) {
  using Keys = std::set<std::string>;
  EXPECT_EQ(changed_keys(scene_with({}), scene_with({})), Keys{});
  EXPECT_EQ(
      changed_keys(scene_with({}), scene_with({"material.E=2e5", "material.nu=0.4", "gravity=[1,2,3]"})),
      (Keys{"material.E", "material.nu", "gravity"}));
  EXPECT_EQ(changed_keys(scene_with({}), scene_with({"loads.0.pressure=6", "loads.1.pressure=7"})),
            Keys{"loads.pressure"});
  EXPECT_EQ(changed_keys(scene_with({}), scene_with({"collapse.least=0.2", "collapse.surface=false",
                                                     "obstacles.0.friction=1"})),
            (Keys{"collapse.least", "collapse.surface", "obstacles.friction"}));
  EXPECT_EQ(changed_keys(scene_with({}), scene_with({"time.step=0.02", "time.integrator=bdf2",
                                                     "reference.integrator=minimising_euler"})),
            (Keys{"time.step", "time.integrator", "reference.integrator"}));
  EXPECT_EQ(changed_keys(scene_with({}), scene_with({"reference.spectral_radius=0.5"})),
            Keys{"reference.spectral_radius"});
}

TEST(ChangedKeys, HoldThoseOfATableThatOneSceneLacks) {
  Scene without = scene_with({});
  without.collapse.reset();
  without.obstacles.clear();
  const std::set<std::string> changed = changed_keys(scene_with({}), without);
  EXPECT_EQ(changed, changed_keys(without, scene_with({})));
  for (const char* key : {"collapse.coefficient", "collapse.pivots.point", "obstacles.friction"})
    EXPECT_EQ(changed.count(key), 1) << key;
  for (const std::string& key : changed)
    EXPECT_TRUE(is_of(key, "collapse") || is_of(key, "obstacles")) << key;
}

TEST(ChangedKeys, OfWhatARunIsBuiltOnAreRefusedByName) {
  for (const std::string key :
       {"surface.n_vertices=100", "surface.across=2", "surface.at_supports=1", "network.seed=2",
        "network.phi=0.2", "reference.degree=1", "reference.refine=1", "reference.interior_size=0.1",
        "reference.mass=lumped", "material.rho=1", "material.damping=1", "volume.coefficient=20",
        "skin.stiffness=20", "self_contact.friction=0.1", "time.end=2", "time.residual=1e-3"})
    EXPECT_EQ(refusal_of(key), key.substr(0, key.find('=')) + " changes in a run, expected a new run");
  EXPECT_EQ(refusal_of("supports.0.end=1"), "supports.end changes in a run, expected a new run");
  EXPECT_EQ(refusal_of("loads.0.traction=[1,1,1]"), "loads.traction changes in a run, expected a new run");
}

// Without an obstacle the law that nobody named is that of small strain.
TEST(ChangedKeys, ThatImplyAnotherLawAreRefused) {
  Scene touched, free;
  touched.obstacles.emplace_back();
  EXPECT_THROW(changed_keys(touched, free), std::runtime_error);
  touched.material.law = free.material.law = MaterialLaw::NeoHookean;
  EXPECT_NO_THROW(changed_keys(touched, free));
}

TEST(StepsFrom, AreThoseOfTheWholeRunWhereverItIs) {
  for (const double step : {0.1, 0.01, 0.03, 1. / 3, 2.}) {
    TimeOptions time;
    const int n = n_steps(time, step);
    double sum = 0;
    for (int k = 0; k <= n; ++k, sum += step) {
      EXPECT_EQ(n_steps_from(time, step, k * step, k), n) << step << ' ' << k;
      EXPECT_EQ(n_steps_from(time, step, sum, k), n) << step << ' ' << k;
    }
  }
}

TEST(StepsFrom, LeadToTheEndByAnotherLength) {
  TimeOptions time;
  EXPECT_EQ(n_steps_from(time, 0.05, 0.4, 4), 4 + 12);
  EXPECT_EQ(n_steps_from(time, 0.07, 0.4, 4), 4 + 9);
  EXPECT_EQ(n_steps_from(time, 5, 0.4, 4), 4 + 1);
  EXPECT_EQ(n_steps_from(time, 0.05, 1.01, 4), 4) << "it is over";
}

}  // namespace
}  // namespace testbed::meshing
