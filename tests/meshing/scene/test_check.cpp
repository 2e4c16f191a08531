#include <gtest/gtest.h>

#include "meshing/scene/check.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/surfaces.h"

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

TEST(CheckScene, RefusesSelfContactInStaticScenesAndContactsWithATolerance) {
  for (const bool is_self : {false, true}) {
    Scene scene = ball();
    if (is_self)
      scene.self_contact.is_on = true;
    else
      scene.obstacles.emplace_back();
    EXPECT_EQ(refusal_of(scene),
              is_self ? "a.toml: self_contact.on = true, expected false with time.mode = static" : "");
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

/// Two balls of radius 1 about the origin and x = 5.
SurfaceMesh two_balls() {
  const SurfaceMesh one = make_shape("ball", 162);
  const Eigen::Index n = one.X.cols(), m = one.F.cols();
  SurfaceMesh both{Eigen::Matrix3Xd(3, 2 * n), Eigen::Matrix3Xi(3, 2 * m)};
  both.X << one.X, one.X.colwise() + Eigen::Vector3d(5, 0, 0);
  both.F << one.F, one.F.array() + static_cast<int>(n);
  return both;
}

std::string refusal_on(const Scene& scene, const SurfaceMesh& surface) {
  try {
    check_supports(scene, surface, discretise(scene, surface), "a.toml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

void expect_parts(const std::string& text, const std::vector<std::string>& parts) {
  for (const std::string& part : parts)
    EXPECT_NE(text.find(part), std::string::npos) << part << " in " << text;
}

TEST(Discretise, RefusesARegionThatHoldsNothingWithItsPlaceAndTheBodysBox) {
  const SurfaceMesh surface = make_shape("bar", 100, {3, 2, 1});
  Scene scene = ball();
  scene.supports.emplace_back().region.shape = Box{{90, 0, 0}, {99, 1, 1}};
  scene.places["supports.0.region"] = "a.toml:7";
  expect_parts(refusal_on(scene, surface), {"a.toml:7: supports.0.region: no node", "from 0 0 0 to 3 2 1"});
  scene.supports.clear();
  scene.loads.emplace_back().region.shape = Ball{{9, 9, 9}, 1};
  expect_parts(refusal_on(scene, surface), {"loads.0.region: no triangle"});
}

/// Displacement of points X in a motion, see free_motions.
Eigen::Matrix3Xd displacement_of(const Eigen::VectorXd& motion, const Eigen::Matrix3Xd& X) {
  Eigen::Matrix3Xd u(3, X.cols());
  for (Eigen::Index i = 0; i < X.cols(); ++i)
    u.col(i) = motion.head<3>() + Eigen::Vector3d(motion.tail<3>()).cross(Eigen::Vector3d(X.col(i)));
  return u;
}

TEST(FreeMotions, AreThoseThatASupportOnAPlaneLeavesWhereverItIs) {
  SurfaceMesh surface = make_shape("bar", 100, {3, 2, 1});
  surface.X.colwise() += Eigen::Vector3d(5, -7, 2);
  const Eigen::Vector3d normal = Eigen::Vector3d(1, 2, -1).normalized();
  Scene scene = ball();
  EXPECT_EQ(free_motions(discretise(scene, surface), surface.X).cols(), 6);
  Support& support = scene.supports.emplace_back();
  support.region.shape = HalfSpace{surface.X.rowwise().mean(), {1, 0, 0}};
  support.normal = normal;
  const SurfaceProblem problem = discretise(scene, surface);
  const Eigen::MatrixXd motions = free_motions(problem, surface.X);
  ASSERT_EQ(motions.cols(), 3);
  for (const auto& motion : motions.colwise())
    EXPECT_LT(
        (normal.transpose() * displacement_of(motion, surface.X)(Eigen::all, problem.constrained[0].vertices))
            .norm(),
        1e-9);
  support.normal.reset();
  support.fixed = {{true, true, true}};
  EXPECT_EQ(free_motions(discretise(scene, surface), surface.X).cols(), 0);
}

TEST(FreeMotions, AreATurnAboutAHingeThatIsNotAtTheCentre) {
  SurfaceMesh surface = make_shape("bar", 100, {3, 2, 1});
  surface.X.colwise() += Eigen::Vector3d(5, -7, 2);
  Scene scene = ball();
  scene.supports.emplace_back().region = {Box{{0, 0, 0}, {1, 1e-6, 1e-6}}, true};
  const SurfaceProblem problem = discretise(scene, surface);
  const Eigen::MatrixXd motions = free_motions(problem, surface.X);
  ASSERT_EQ(motions.cols(), 1);
  const Eigen::Matrix3Xd u = displacement_of(motions.col(0), surface.X);
  EXPECT_LT(u(Eigen::all, problem.constrained[0].vertices).norm(), 1e-9);
  EXPECT_GT(u.norm(), 0.1);
}

TEST(CheckSupports, RefusesAPartWithoutTheSupportThatOthersHaveInStaticsAlone) {
  const SurfaceMesh surface = two_balls();
  Scene scene = ball();
  expect_parts(refusal_on(scene, surface), {"2 of the surface's 2 parts meet no support"});
  EXPECT_EQ(refusal_on(scene, make_shape("ball", 100)), "") << "one free body";
  scene.supports.emplace_back().region.shape = HalfSpace{{0, 0, 0}, {1, 0, 0}};
  expect_parts(refusal_on(scene, surface),
               {"1 of the surface's 2 parts meet no support", "from  4 -1 -1 to 6 1 1"});
  Scene moving = scene, constrained = scene, on_a_floor = scene;
  moving.time.mode = TimeMode::Dynamic;
  constrained.supports[0].region.shape = Everywhere{};
  on_a_floor.obstacles.emplace_back();
  for (const Scene& other : {moving, constrained, on_a_floor}) EXPECT_EQ(refusal_on(other, surface), "");
}

TEST(CheckSupports, KnowsThatInertiaBalancesTheRigidMotionsOfOneBody) {
  Scene scene = ball();
  scene.reference.inertia_relief = true;
  EXPECT_EQ(refusal_on(scene, make_shape("ball", 100)), "");
  expect_parts(refusal_on(scene, two_balls()), {"2 of the surface's 2 parts meet no support"});
}

TEST(CheckSupports, TakesPartsThatSeamsTieForOne) {
  const SurfaceMesh surface = two_balls();
  SurfaceMesh third = make_shape("ball", 42);
  third.X.row(0).array() -= 5;
  Scene scene = ball();
  Seam& seam = scene.seams.emplace_back();
  seam.from.shape = Box{{0.5, -1, -1}, {1, 1, 1}};
  seam.to.shape = Box{{4, -1, -1}, {4.5, 1, 1}};
  EXPECT_EQ(refusal_on(scene, surface), "") << "one free body";
  scene.supports.emplace_back().region.shape = Box{{5.5, -1, -1}, {6, 1, 1}};
  EXPECT_EQ(refusal_on(scene, surface), "");
  expect_parts(refusal_on(scene, join(surface, third)),
               {"1 of the surface's 2 parts meet no support", "from -6 -1 -1 to -4  1  1"});
}

TEST(CheckSupports, TakesTheWallOfACavityForAPartOfItsBody) {
  const SurfaceMesh surface = make_shape("hollow_ball", 642);
  Scene scene = ball();
  const double low = surface.X.row(1).minCoeff();
  scene.supports.emplace_back().region.shape = HalfSpace{{0, 0.9 * low, 0}, {0, 1, 0}};
  EXPECT_EQ(refusal_on(scene, surface), "");
}

TEST(CheckSupports, TellsBodiesInOneCavityApart) {
  SurfaceMesh left = scaled(make_shape("ball", 42), 0.1), right = left;
  left.X.row(0).array() -= 0.2;
  right.X.row(0).array() += 0.2;
  const SurfaceMesh surface = join(make_shape("hollow_ball", 642), join(left, right));
  Scene scene = ball();
  scene.supports.emplace_back().region.shape = HalfSpace{{0, 0, 0}, {1, 0, 0}};
  expect_parts(refusal_on(scene, surface), {"1 of the surface's 3 parts meet no support"});
}

Scene loaded_ball() {
  Scene scene = ball();
  scene.gravity = Eigen::Vector3d(0, -9.81, 0);
  return scene;
}

std::string refusal_of_motion(const Scene& scene, const SurfaceMesh& surface) {
  try {
    check_motion(scene, surface, "a.toml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(CheckMotion, RefusesABodyThatNothingMovesWithTheLineOfWhatIsZero) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Scene idle = ball();
  EXPECT_EQ(refusal_of_motion(idle, surface).rfind("a.toml: nothing moves the body, expected gravity", 0), 0);
  idle.places["surface"] = "a.toml:1";
  EXPECT_EQ(refusal_of_motion(idle, surface).rfind("a.toml:1: nothing moves the body", 0), 0);
  idle.supports.emplace_back().motion = {{0, 0, 0, 0}, {1, 0, 0, 0}};
  idle.loads.emplace_back().stress.push_back(StressTerm::Zero());
  idle.initial.emplace_back();
  idle.volume.emplace().coefficient = 1;
  idle.volume->target = {{0, 1}, {1, 1}};
  idle.collapse.emplace();
  idle.skin.emplace().stiffness = 1;
  idle.gravity = Eigen::Vector3d::Zero();
  idle.places["gravity"] = "a.toml:3";
  EXPECT_EQ(refusal_of_motion(idle, surface).rfind("a.toml:3: nothing moves the body", 0), 0);
}

TEST(CheckMotion, AcceptsWhateverMayMoveABody) {
  const SurfaceMesh surface = make_shape("ball", 162);
  const auto expect_driven_by = [&](const char* what, auto change) {
    Scene scene = moving_ball();
    change(scene);
    EXPECT_EQ(refusal_of_motion(scene, surface), "") << what;
  };
  expect_driven_by("gravity", [](Scene& s) { s.gravity = Eigen::Vector3d(0, 1, 0); });
  expect_driven_by("pressure", [](Scene& s) { s.loads.emplace_back().pressure = 1; });
  expect_driven_by("traction", [](Scene& s) { s.loads.emplace_back().traction(0) = 1; });
  expect_driven_by("stress", [](Scene& s) { s.loads.emplace_back().stress.push_back(StressTerm::Ones()); });
  expect_driven_by("displacement", [](Scene& s) { s.supports.emplace_back().displacement(1) = 1; });
  expect_driven_by("motion", [](Scene& s) {
    s.supports.emplace_back().motion = {{0, 0, 0, 0}, {1, 0, 1, 0}};
  });
  expect_driven_by("velocity", [](Scene& s) { s.initial.emplace_back().velocity(0) = 1; });
  expect_driven_by("spin", [](Scene& s) { s.initial.emplace_back().spin(0) = 1; });
  expect_driven_by("collapse", [](Scene& s) { s.collapse.emplace().pivots.emplace_back(); });
  expect_driven_by("held volume", [](Scene& s) {
    s.volume.emplace().is_exact = true;
    s.volume->target = {{0, 1}, {1, 0.5}};
  });
  expect_driven_by("volume", [](Scene& s) {
    s.volume.emplace().local = 1;
    s.volume->target = {{0, 1}, {1, 0.5}};
  });
  expect_driven_by("seam", [](Scene& s) { s.seams.emplace_back(); });
  expect_driven_by("handle", [](Scene& s) { s.handles.emplace_back(); });
  expect_driven_by("event", [](Scene& s) { s.events.emplace_back(); });
  expect_driven_by("obstacle", [](Scene& s) { s.obstacles.emplace_back(); });
  expect_driven_by("self-contact", [](Scene& s) { s.self_contact.is_on = true; });
  expect_driven_by("relaxation", [](Scene& s) { s.skin.emplace().relaxation = 0.1; });
}

TEST(CheckMotion, RefusesASurfaceThatSupportsHoldEverywhereWithTheirLine) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Scene clamped = loaded_ball();
  clamped.places["supports"] = "a.toml:7";
  clamped.supports.emplace_back();
  expect_parts(refusal_of_motion(clamped, surface), {"a.toml:7: supports hold the whole surface"});
  Scene moving = clamped, split = clamped, part = clamped, sliding = clamped, ending = clamped,
        moved = clamped;
  moving.time.mode = TimeMode::Dynamic;
  split.supports[0].normal = Eigen::Vector3d(1, 2, 0);
  split.supports.emplace_back().along = Eigen::Vector3d(1, 2, 0);
  for (const Scene& other : {moving, split})
    expect_parts(refusal_of_motion(other, surface), {"supports hold the whole surface"});
  part.supports[0].region.shape = HalfSpace{{0, 0.9, 0}, {0, 1, 0}};
  sliding.supports[0].fixed[1] = false;
  ending.supports[0].end = 1;
  moved.supports[0].displacement(0) = 1;
  for (const Scene& other : {part, sliding, ending, moved}) EXPECT_EQ(refusal_of_motion(other, surface), "");
}

TEST(CheckMotion, AcceptsABeamWhoseCornersAreAllClampedWhereItIsCutBetweenThem) {
  const SurfaceMesh beam = make_shape("bar", 8, {8, 1, 1});
  ASSERT_EQ(beam.X.row(0).unaryExpr([](double x) { return x > 0 && x < 8; }).count(), 0);
  Scene scene = loaded_ball();
  scene.supports.resize(2);
  scene.supports[0].region.shape = HalfSpace{{0, 0, 0}, {1, 0, 0}};
  scene.supports[1].region.shape = HalfSpace{{8, 0, 0}, {-1, 0, 0}};
  EXPECT_EQ(refusal_of_motion(scene, beam), "");
  scene.surface.across = 0;
  expect_parts(refusal_of_motion(scene, beam), {"supports hold the whole surface"});
}

std::string warnings(const Scene& scene, const SurfaceMesh& surface) {
  std::string all;
  for (const std::string& warning : warnings_about(scene, surface, "a.toml")) all += warning + '\n';
  return all;
}

TEST(WarningsAbout, AreNoneWhereAllMakesSense) {
  EXPECT_EQ(warnings(loaded_ball(), make_shape("ball", 162)), "");
}

TEST(WarningsAbout, NameUnitsThatMakeNoSenseWithTheirPlace) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Scene scene = loaded_ball();
  scene.material.E = 1e-3;
  scene.places["material.E"] = "a.toml:3";
  expect_parts(warnings(scene, surface), {"a.toml:3: material.E = 0.001 Pa"});
  scene = loaded_ball();
  for (const double scale : {49.5, 1e-5})
    expect_parts(warnings(scene, {scale * surface.X, surface.F}), {"millimetres?", "--units mm"});
  for (const double scale : {24.0, 1e-3}) EXPECT_EQ(warnings(scene, {scale * surface.X, surface.F}), "");
}

TEST(WarningsAbout, NameAUnitThatNormalisingMakesVoid) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Scene scene = loaded_ball();
  scene.surface.unit = LengthUnit::Millimetre;
  EXPECT_EQ(warnings(scene, surface), "");
  scene.surface.normalise = true;
  scene.places["surface.unit"] = "--set surface.unit=\"mm\"";
  expect_parts(warnings(scene, surface), {"--set surface.unit=\"mm\": surface.unit has no effect with"});
  scene.surface.unit = LengthUnit::Metre;
  EXPECT_EQ(warnings(scene, surface), "") << "a filled-in scene names it";
  scene.surface.scale = 2;
  expect_parts(warnings(scene, surface), {"surface.scale has no effect with"});
}

TEST(WarningsAbout, NameNeedlesWithTheirShareAndTheCommandThatHelps) {
  SurfaceMesh surface = make_shape("ball", 162);
  surface.X.row(2) *= 1e-3;
  Scene scene = loaded_ball();
  scene.surface.across = 0;
  expect_parts(warnings(scene, surface), {"of 320 triangles are needles (aspect above 100", "run --remesh"});
}

TEST(WarningsAbout, NameNoNeedlesThatCutsMend) {
  const SurfaceMesh plate = fanned_plate(301);
  Scene scene = loaded_ball();
  EXPECT_EQ(warnings(scene, plate), "");
  scene.surface.across = 0;
  expect_parts(warnings(scene, plate), {" of 1208 triangles are needles"});
}

TEST(WarningsAbout, NameASurfaceThatCrossesItselfAndTheCommandThatHelps) {
  SurfaceMesh surface = two_balls();
  surface.X.rightCols(162).row(0).array() -= 4;
  expect_parts(warnings(loaded_ball(), surface), {"pairs of triangles cross", "run --remesh"});
}

TEST(CheckScene, RefusesAWantedStrainOfWhatDoesNotGrowWithTheLoads) {
  Scene scene = loaded_ball();
  scene.load_scale.strain = 1e-3;
  EXPECT_EQ(refusal_of(scene), "");
  Scene moved = scene, shrunk = scene, moving = scene, follower = scene, idle = scene;
  moved.supports.emplace_back().displacement(0) = 1;
  shrunk.collapse.emplace();
  moving.time.mode = TimeMode::Dynamic;
  follower.loads.emplace_back().is_follower = true;
  idle.gravity.reset();
  for (const auto& [other, why] : {std::pair(moved, "prescribed displacements"),
                                   {shrunk, "collapse"},
                                   {moving, "dynamic"},
                                   {follower, "a follower load"},
                                   {idle, "no gravity and no load"}})
    expect_parts(refusal_of(other), {"load_scale.strain = 0.001, expected proportional loads", why});
}

TEST(LoadScale, MultipliesGravityAndEveryLoad) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Scene scene = loaded_ball();
  Load& load = scene.loads.emplace_back();
  load.pressure = 3;
  load.traction = {1, 2, 3};
  load.stress.push_back(StressTerm::Ones());
  Load follower;
  follower.pressure = 5;
  follower.is_follower = true;
  scene.loads.push_back(follower);
  const SurfaceProblem plain = discretise(scene, surface);
  scene.load_scale.factor = 0.25;
  const SurfaceProblem scaled = discretise(scene, surface);
  EXPECT_EQ(*gravity_of(scene), 0.25 * *scene.gravity);
  EXPECT_EQ(scaled.traction, 0.25 * plain.traction);
  EXPECT_EQ(scaled.follower_pressure, 0.25 * plain.follower_pressure);
  const StressTerm term = scaled.stressed[0].terms[0];
  EXPECT_EQ(term.head<3>(), Eigen::Vector3d::Ones());
  EXPECT_TRUE((term.tail<6>().array() == 0.25).all());
}

TEST(Loads, AddUpOnATriangle) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Scene scene;
  for (const double sign : {1., 2.}) {
    Load& load = scene.loads.emplace_back();
    load.traction = sign * Eigen::Vector3d(1, 2, 3);
    load.pressure = sign * 4;
    Load& follower = scene.loads.emplace_back();
    follower.pressure = sign * 5;
    follower.is_follower = true;
  }
  const SurfaceProblem problem = discretise(scene, surface);
  const Eigen::Matrix3Xd normals = area_vectors(surface.X, surface.F).colwise().normalized();
  EXPECT_LT((problem.traction - ((-12 * normals).colwise() + Eigen::Vector3d(3, 6, 9))).norm(), 1e-12);
  EXPECT_TRUE((problem.follower_pressure.array() == 15).all());
}

TEST(LoadScale, IsRefusedWhileTheFactorForAWantedStrainIsNotFound) {
  Scene scene = loaded_ball();
  EXPECT_EQ(load_factor_of(scene), 1);
  scene.load_scale.strain = 1e-3;
  EXPECT_THROW(load_factor_of(scene), std::runtime_error);
  scene.load_scale.factor = 0.5;
  EXPECT_EQ(load_factor_of(scene), 0.5);
}

}  // namespace
}  // namespace testbed::meshing
