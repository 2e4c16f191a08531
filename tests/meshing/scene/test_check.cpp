#include <gtest/gtest.h>

#include "meshing/scene/check.h"

namespace testbed::meshing {
namespace {

Scene ball() {
  Scene scene;
  scene.surface.shape = "ball";
  return scene;
}

Scene moving_ball() {
  Scene scene = ball();
  scene.time.mode = TimeMode::Dynamic;
  return scene;
}

std::string refusal_of(const Scene& scene) {
  try {
    check_scene(scene, "a.toml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(CheckScene, AcceptsWhatGoesTogether) {
  EXPECT_EQ(refusal_of(ball()), "");
  Scene scene = moving_ball();
  scene.obstacles.emplace_back();
  scene.self_contact.is_on = true;
  scene.skin.emplace();
  EXPECT_EQ(refusal_of(scene), "");
}

TEST(CheckScene, RefusesContactsInStaticScenesAndWithATolerance) {
  const char* in_statics = "a.toml: obstacles or self_contact, expected none with time.mode = static";
  for (const bool is_self : {false, true}) {
    Scene scene = ball();
    if (is_self)
      scene.self_contact.is_on = true;
    else
      scene.obstacles.emplace_back();
    EXPECT_EQ(refusal_of(scene), in_statics);
    scene.time.mode = TimeMode::Dynamic;
    EXPECT_EQ(refusal_of(scene), "");
    scene.time.tolerance = 0.01;
    EXPECT_EQ(refusal_of(scene), "a.toml: time.tolerance = 0.01, expected 0 with obstacles or self_contact");
  }
  Scene scene = moving_ball();
  scene.time.tolerance = 0.01;
  EXPECT_EQ(refusal_of(scene), "");
}

TEST(CheckScene, RefusesRelaxationThatNothingDrives) {
  Scene scene = moving_ball();
  scene.skin.emplace().relaxation = 0.1;
  EXPECT_EQ(refusal_of(scene), "a.toml: skin.relaxation = 0.1, expected skin.bending > 0 to drive it");
  scene.skin->bending = 1;
  EXPECT_EQ(refusal_of(scene), "");
}

TEST(CheckScene, RefusesSmallStrainWhereAPartGoesBeyondIt) {
  Scene scene = moving_ball();
  scene.material.law = MaterialLaw::SmallStrain;
  EXPECT_EQ(refusal_of(scene), "");
  scene.loads.emplace_back().is_follower = true;
  EXPECT_EQ(refusal_of(scene),
            "a.toml: material.law = small_strain, expected neo_hookean with a follower load: it acts on the "
            "surface "
            "where that is, not where it was at rest");
  scene.material.law = MaterialLaw::NeoHookean;
  EXPECT_EQ(refusal_of(scene), "");
}

TEST(CheckScene, RefusesASpectralRadiusOfCentralDifferences) {
  Scene scene = moving_ball();
  scene.reference.spectral_radius = 0.5;
  EXPECT_EQ(refusal_of(scene), "");
  scene.reference.integrator = ReferenceScheme::CentralDifferences;
  EXPECT_EQ(refusal_of(scene),
            "a.toml: reference.spectral_radius = 0.5, expected none with reference.integrator = "
            "central_differences, which has no such parameter");
}

TEST(UnmodelledPart, NamesWhatTheReferenceLeavesOut) {
  EXPECT_EQ(unmodelled_part(ball()), "");
  EXPECT_EQ(unmodelled_part(moving_ball()), "");
  const auto part_with = [](Scene scene, auto change) {
    change(scene);
    const std::string part = unmodelled_part(scene);
    return part.substr(0, part.find(':'));
  };
  EXPECT_EQ(part_with(moving_ball(), [](Scene& s) { s.obstacles.emplace_back(); }),
            "obstacles or self_contact");
  EXPECT_EQ(part_with(moving_ball(), [](Scene& s) { s.self_contact.is_on = true; }),
            "obstacles or self_contact");
  EXPECT_EQ(part_with(ball(), [](Scene& s) { s.volume.emplace(); }), "volume or skin");
  EXPECT_EQ(part_with(ball(), [](Scene& s) { s.skin.emplace(); }), "volume or skin");
  EXPECT_EQ(part_with(ball(), [](Scene& s) { s.collapse.emplace().pivots.emplace_back(); }), "");
  EXPECT_EQ(part_with(ball(), [](Scene& s) { s.collapse.emplace().pivots.emplace_back().end = 1; }),
            "collapse.pivots with motion or end");
  EXPECT_EQ(part_with(moving_ball(), [](Scene& s) { s.collapse.emplace(); }),
            "collapse with time.mode = \"dynamic\"");
  EXPECT_EQ(part_with(ball(), [](Scene& s) { s.reference.inertia_relief = true; }), "");
  EXPECT_EQ(part_with(moving_ball(), [](Scene& s) { s.reference.inertia_relief = true; }),
            "reference.inertia_relief");
  EXPECT_EQ(part_with(moving_ball(),
                      [](Scene& s) {
                        s.reference.integrator = ReferenceScheme::CentralDifferences;
                        s.material.stiffness_damping = 0.1;
                      }),
            "material.stiffness_damping with reference.integrator = central_differences");
  const auto damp_at_finite_strain = [](Scene& s) {
    s.material.law = MaterialLaw::NeoHookean;
    s.material.stiffness_damping = 0.1;
  };
  EXPECT_EQ(part_with(moving_ball(), damp_at_finite_strain), "material.stiffness_damping at finite strain");
  EXPECT_EQ(part_with(ball(), damp_at_finite_strain), "");
}

}  // namespace
}  // namespace testbed::meshing
