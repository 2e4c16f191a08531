#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "massspring/calibrations/calibrate.h"
#include "massspring/choices/check_model.h"
#include "massspring/time/schemes.h"

namespace testbed::massspring {
namespace {

std::string refusal_of(const Scene& scene, const std::string& model) {
  try {
    check_model(scene, model, "a.toml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

Scene moving() {
  Scene scene;
  scene.time.mode = TimeMode::Dynamic;
  return scene;
}

TEST(CheckModel, AcceptsPoissonsRatiosAsCalibrateDoes) {
  SpringNetwork network;  // refused for want of tetrahedra, but later
  network.X.setRandom(3, 4);
  network.F.resize(3, 0);
  network.E.resize(2, 0);
  for (const double nu : {-0.5, 0., 0.2, 0.25, 0.4, 0.499, 0.4995})
    for (const Calibration& calibration : calibrations()) {
      Scene scene;
      scene.material.nu = nu;
      const std::string refusal = refusal_of(scene, calibration.name);
      EXPECT_EQ(refusal.empty(), nu >= calibration.least_nu && nu <= calibration.largest_nu)
          << calibration.name << nu;
      if (refusal.empty()) continue;
      try {
        calibrate(network, scene.material, calibration);
        ADD_FAILURE() << calibration.name << nu;
      } catch (const std::runtime_error& error) {
        EXPECT_EQ(refusal, std::string("a.toml: ") + error.what());
      }
    }
  Scene scene;
  scene.material.nu = 0.2;
  EXPECT_EQ(refusal_of(scene, "lloyd"),
            "a.toml: material.nu = 0.2, expected 0.25 to 0.499 with lloyd springs");
}

TEST(CheckModel, RefusesUnknownNamesWithTheNearest) {
  EXPECT_NE(refusal_of(Scene(), "node_average").find("did you mean node_averaged?"), std::string::npos);
  Scene scene;
  scene.time.integrator = "bdf3";
  EXPECT_NE(refusal_of(scene, "uniform").find("did you mean bdf2?"), std::string::npos);
}

TEST(CheckModel, RefusesLinksWhereTheMaterialHasNoShareForThem) {
  Scene scene;
  scene.network.link_share = 0.3;
  EXPECT_EQ(refusal_of(scene, "node_averaged"), "");
  EXPECT_EQ(refusal_of(scene, "uniform"),
            "a.toml: network.link_share = 0.300000, expected 0 with uniform springs: they are not coupled");
  scene.material.nu = 0.1;  // lambda/mu = 1/4
  EXPECT_EQ(
      refusal_of(scene, "node_averaged"),
      "a.toml: network.link_share = 0.300000, expected at most lambda/mu = 0.250000: links alone have nu "
      "= 1/4");
  scene.material.nu = 0.4985;  // 0.499 is what is left for coupled springs by a share of 0.33
  EXPECT_EQ(refusal_of(scene, "node_averaged"), "");
  scene.network.link_share = 0.4;
  EXPECT_NE(refusal_of(scene, "node_averaged"), "");
}

TEST(CheckModel, RefusesWhatTheIntegratorCannotDoInMotionsAlone) {
  Scene scene = moving();
  scene.obstacles.emplace_back();
  EXPECT_EQ(refusal_of(scene, "uniform"), "");
  scene.time.integrator = "midpoint";
  EXPECT_EQ(refusal_of(scene, "uniform"),
            "a.toml: time.integrator = midpoint with obstacles, expected another one");
  Scene remembering = moving();
  remembering.time.tolerance = 0.01;
  EXPECT_EQ(refusal_of(remembering, "uniform"), "");
  remembering.time.integrator = "bdf2";
  EXPECT_NE(refusal_of(remembering, "uniform"), "");
  remembering.time.mode = TimeMode::Static;
  EXPECT_EQ(refusal_of(remembering, "uniform"), "");
}

TEST(CheckModel, RefusesSkinVolumeAndDampingThatItsSpringsDoNotHave) {
  Scene relaxing = moving();
  relaxing.skin = Skin{0, 1, 0.1};
  EXPECT_EQ(refusal_of(relaxing, "uniform"), "");
  EXPECT_EQ(
      refusal_of(relaxing, "node_averaged"),
      "a.toml: skin.relaxation = 0.1, expected skin.stiffness > 0 with node_averaged springs: it shortens "
      "springs along the surface");
  relaxing.skin->stiffness = 1;
  EXPECT_EQ(refusal_of(relaxing, "node_averaged"), "");

  Scene filled;
  filled.volume.emplace().local = 5;
  EXPECT_EQ(refusal_of(filled, "node_averaged"), "");
  EXPECT_EQ(refusal_of(filled, "uniform"),
            "a.toml: volume.local = 5, expected 0 with uniform springs: their network has no tetrahedra");

  Scene held = moving();
  held.volume.emplace().is_exact = true;
  held.volume->target = {{0, 1}};
  for (const Integrator& integrator : integrators()) {
    held.time.integrator = integrator.name;
    EXPECT_EQ(refusal_of(held, "uniform"), integrator.name == "minimising_euler" || integrator.name == "bdf2"
                                               ? ""
                                               : "a.toml: time.integrator = " + integrator.name +
                                                     ", expected minimising_euler or bdf2 with volume.exact");
  }
  held.time.mode = TimeMode::Static;
  EXPECT_EQ(refusal_of(held, "uniform"), "");

  Scene damped = moving();
  damped.material.stiffness_damping = 0.1;
  EXPECT_EQ(refusal_of(damped, "uniform"),
            "a.toml: material.stiffness_damping = 0.1, expected 0: only the reference has it");
  damped.time.mode = TimeMode::Static;
  EXPECT_EQ(refusal_of(damped, "uniform"), "");
}

TEST(CheckModel, AcceptsEveryModelOfShippedScenes) {
  int n_checked = 0;
  for (const auto& entry : std::filesystem::directory_iterator(SCENE_FOLDER)) {
    if (entry.path().extension() != ".toml") continue;
    const Scene scene = read_scene(entry.path());
    for (const std::string& model : models_of(scene)) EXPECT_EQ(refusal_of(scene, model), "") << entry.path();
    EXPECT_EQ(unused_keys(scene), std::vector<std::string>()) << entry.path();
    ++n_checked;
  }
  EXPECT_GT(n_checked, 0);
}

using Keys = std::vector<std::string>;

TEST(WhyNotEstimated, NamesLinksMotionSeamsEventsAndTheDefaultDepthOfACollapse) {
  const auto why = [](const std::string& model, const auto& change) {
    Scene scene;
    change(scene);
    return why_not_estimated(scene, find_calibration(model));
  };
  const auto nothing = [](Scene&) {};
  EXPECT_EQ(why("node_averaged", nothing), "");
  EXPECT_EQ(why("edge_coupled", [](Scene& s) { s.collapse.emplace(); }), "");
  const std::string of_links = why("uniform", nothing);
  EXPECT_NE(of_links.find("does not fall as nodes are added"), std::string::npos);
  EXPECT_EQ(why("lloyd", nothing), of_links);
  EXPECT_EQ(why("node_averaged", [](Scene& s) { s.network.link_share = 0.1; }), of_links);
  EXPECT_NE(why("node_averaged", [](Scene& s) { s.time.mode = TimeMode::Dynamic; }).find("equilibria"),
            std::string::npos);
  EXPECT_NE(why("node_averaged", [](Scene& s) { s.seams.emplace_back(); }).find("stitches"),
            std::string::npos);
  EXPECT_NE(why("node_averaged", [](Scene& s) { s.events.emplace_back(); }).find("events"),
            std::string::npos);
  EXPECT_NE(
      why("node_averaged", [](Scene& s) { s.collapse.emplace().surface = false; }).find("collapse.depth"),
      std::string::npos);
}

TEST(UnusedKeys, AreThoseThatNoModelOfTheComparisonReads) {
  Scene scene;
  scene.network.multiplicity = 7;
  scene.network.spring_damping = 1;
  scene.collapse.emplace().surface = false;
  scene.collapse->least = 0.1;
  EXPECT_EQ(unused_keys(scene), (Keys{"collapse.surface", "network.multiplicity", "network.spring_damping"}));
  scene.comparison.calibrations = {"lloyd"};
  EXPECT_EQ(unused_keys(scene), Keys{"network.multiplicity"});
  scene.comparison.calibrations = {"edge_coupled", "uniform"};
  EXPECT_EQ(unused_keys(scene), Keys{});
  scene.comparison.calibrations.clear();
  scene.network.link_share = 0.3;
  EXPECT_EQ(unused_keys(scene), Keys{});
}

TEST(UnusedKeys, HangOnTheNodesTheLinksAndTheIntegrator) {
  Scene scene;
  scene.network.calibration = "uniform";
  scene.network.neighbours = 9;
  scene.network.spacing = 0.5;
  scene.network.mass = MassMatrix::Lumped;
  EXPECT_EQ(unused_keys(scene), (Keys{"network.spacing", "network.neighbours", "network.mass"}));
  scene.network.connectivity = "completed_pcp";
  scene.network.sampling = "mesher";
  scene.network.phi = 0.1;
  EXPECT_EQ(unused_keys(scene), (Keys{"network.phi", "network.mass"}));

  Scene motion = moving();
  motion.time.bend_gradient = false;
  motion.network.mass = MassMatrix::Lumped;
  EXPECT_EQ(unused_keys(motion), Keys{});
  motion.time.integrator = "rk4";
  EXPECT_EQ(unused_keys(motion), (Keys{"time.bend_gradient", "network.mass"}));
}

TEST(UnusedKeys, HoldTheLawOfSpringsWhereStrainsAreSmall) {
  Scene scene;
  scene.network.calibration = "uniform";
  scene.network.spring_law = SpringLaw::Definite;
  EXPECT_EQ(unused_keys(scene), Keys{"network.spring_law"});
  scene.material.law = MaterialLaw::NeoHookean;
  EXPECT_EQ(unused_keys(scene), Keys{});
}

TEST(UnusedKeys, AreNoneWhereAFilledInSceneHoldsDefaults) {
  const auto file = std::filesystem::temp_directory_path() / "testbed_filled_in.toml";
  for (const Calibration& calibration : calibrations()) {
    Scene scene;
    scene.name = "ball";
    scene.surface.shape = "ball";
    scene.network.calibration = calibration.name;
    scene.collapse.emplace();
    std::ofstream(file) << to_toml(scene);
    EXPECT_EQ(unused_keys(read_scene(file)), Keys{}) << calibration.name;
  }
}

}  // namespace
}  // namespace testbed::massspring
