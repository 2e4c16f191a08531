// A state holds all that decides how a run goes on, and a run may go on under other values.
#include <gtest/gtest.h>

#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "massspring/simulation.h"
#include "tests/meshing/two_bars.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kStep = 2e-3;

struct TwoBars {
  SpringNetwork network;
  Scene scene;

  explicit TwoBars(const std::string& integrator) {
    const meshing::BarsInContact bars(kStep);
    const TetMesh& mesh = bars.mesh;
    network = {mesh.X, mesh.F, {}, mesh.T, mesh.n_surface};
    scene = bars.scene;
    scene.network.calibration = "node_averaged";
    scene.time.integrator = integrator;
    if (!find_integrator(integrator).ends_where_it_solves) scene.obstacles.clear();
  }
};

Simulation& after(int n_steps, Simulation& simulation) {
  for (int n = 0; n < n_steps; ++n) EXPECT_EQ(simulation.advance(), Status::Ok);
  return simulation;
}

State end_of(const Scene& scene, const SpringNetwork& network, const State& state, int n_steps) {
  Simulation simulation(scene, network);
  simulation.set_state(state);
  return after(n_steps, simulation).state();
}

/// Bit for bit.
void expect_same(const State& found, const State& expected, const std::string& what) {
  EXPECT_EQ(found.x, expected.x) << what;
  EXPECT_EQ(found.v, expected.v) << what;
  EXPECT_EQ(found.rest_length, expected.rest_length) << what;
  EXPECT_EQ(found.patch_scale, expected.patch_scale) << what;
  EXPECT_EQ(found.t, expected.t) << what;
  EXPECT_EQ(found.n_done, expected.n_done) << what;
}

double apart(const State& a, const State& b) {
  return (a.x - b.x).colwise().norm().maxCoeff();
}

constexpr int kBefore = 25, kAfter = 15;  // steps: bars and floor meet after some ten

class StateOf : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(, StateOf, testing::ValuesIn([] {
                           std::vector<std::string> names;
                           for (const Integrator& integrator : integrators())
                             names.push_back(integrator.name);
                           return names;
                         }()),
                         [](const auto& info) { return info.param; });

TEST_P(StateOf, AMotionWithContactIsAllThatDecidesHowItGoesOn) {
  const TwoBars bars(GetParam());
  Simulation whole(bars.scene, bars.network);
  const State middle = after(kBefore, whole).state();
  const State expected = after(kAfter, whole).state();
  const State found = end_of(bars.scene, bars.network, middle, kAfter);
  if (find_integrator(GetParam()).is_explicit) {
    expect_same(found, expected, "nothing is kept");
  } else {
    constexpr double kSolved = 1e-6;  // m: what is kept changes a step within its tolerance
    EXPECT_LT(apart(found, expected), kSolved);
    EXPECT_EQ(found.n_done, expected.n_done);
  }
  Simulation forgetful(bars.scene, bars.network);
  after(kBefore, forgetful).set_state(middle);
  expect_same(found, after(kAfter, forgetful).state(), "forgotten");
}

TEST_P(StateOf, WithWhatIsKeptGoesOnBitForBit) {
  const TwoBars bars(GetParam());
  Simulation whole(bars.scene, bars.network), again(bars.scene, bars.network);
  const std::string saved = after(kBefore, whole).saved();
  const State expected = after(kAfter, whole).state();
  again.restore(saved);
  EXPECT_EQ(again.n_done(), kBefore);
  expect_same(after(kAfter, again).state(), expected, GetParam());
  EXPECT_EQ(again.saved(), whole.saved()) << "ledger, counts and all that is kept";
  EXPECT_EQ(again.report().newton_iterations, whole.report().newton_iterations);
  EXPECT_THROW(again.restore(saved.substr(0, saved.size() - 1)), std::runtime_error);
}

// Without contact, whose matrices no factor serves.
TEST(Saved, HoldsTheFactorThatNewtonsMethodKeeps) {
  TwoBars bars("midpoint");
  bars.scene.self_contact = {};
  bars.scene.volume.reset();
  Simulation whole(bars.scene, bars.network), again(bars.scene, bars.network);
  const std::string saved = after(kBefore, whole).saved();
  ASSERT_EQ(whole.report().solver.rfind("Cholesky factor, kept", 0), 0u) << whole.report().solver;
  again.restore(saved);
  expect_same(after(kAfter, again).state(), after(kAfter, whole).state(), "kept factor");
}

TEST_P(StateOf, ALinearMotionGoesOnBitForBit) {
  TwoBars bars(GetParam());
  bars.scene.material.law = MaterialLaw::SmallStrain;
  bars.scene.obstacles.clear();
  bars.scene.self_contact = {};
  bars.scene.volume.reset();
  bars.scene.skin.reset();
  bars.scene.supports[0].end = kStep * kBefore;
  for (const int n_before : {kBefore - 1, kBefore, kBefore + 1}) {
    Simulation whole(bars.scene, bars.network);
    const State middle = after(n_before, whole).state();
    const State expected = after(kAfter, whole).state();
    ASSERT_TRUE(whole.model().linear);
    expect_same(end_of(bars.scene, bars.network, middle, kAfter), expected, std::to_string(n_before));
  }
}

// What contact and schemes remember decides: a state without it goes elsewhere.
TEST(State, WithoutItsHistoryGoesElsewhere) {
  for (const char* integrator : {"bdf2", "implicit_euler"}) {
    const TwoBars bars(integrator);
    Simulation whole(bars.scene, bars.network);
    State middle = after(kBefore, whole).state();
    const State expected = end_of(bars.scene, bars.network, middle, kAfter);
    middle.history = {};
    EXPECT_GT(apart(end_of(bars.scene, bars.network, middle, kAfter), expected), 1e-4) << integrator;
  }
}

TEST(State, HoldsTheLengthOfTheNextPartOfAStep) {
  TwoBars bars("rk4");
  bars.scene.obstacles.clear();
  bars.scene.self_contact = {};
  bars.scene.time.tolerance = 1e-7;
  bars.scene.time.step = 0.02;
  Simulation whole(bars.scene, bars.network);
  State middle = after(2, whole).state();
  EXPECT_GT(middle.history.part, 0);
  EXPECT_LT(middle.history.part, bars.scene.time.step);
  expect_same(end_of(bars.scene, bars.network, middle, 2), after(2, whole).state(), "in parts");
}

TEST(State, OfABodyThatFrictionHoldsAsleepSleepsOn) {
  TwoBars bars("minimising_euler");
  bars.scene.supports.clear();
  bars.scene.collapse.reset();
  bars.scene.skin.reset();
  bars.scene.volume.reset();
  bars.scene.self_contact = {};
  bars.scene.gravity = Vector3d(2, -9.81, 0);
  bars.scene.material.damping = 20;
  bars.scene.time.sleep_below = 0.02;
  bars.scene.time.step = 0.02;
  bars.scene.time.end = 4;
  Simulation whole(bars.scene, bars.network);
  while (!whole.has_ended() && whole.report().n_at_rest < 3) whole.advance();
  ASSERT_EQ(whole.report().n_at_rest, 3);
  State asleep = whole.state();
  const auto n_at_rest_from = [&](const State& state) {
    Simulation again(bars.scene, bars.network);
    again.set_state(state);
    return after(1, again).report().n_at_rest;
  };
  EXPECT_EQ(n_at_rest_from(asleep), 1);
  asleep.history = {};
  EXPECT_EQ(n_at_rest_from(asleep), 0) << "nothing rubs before a step has begun";
}

/// Statics of one of the bars, clamped; its end is moved.
Scene moved_statically(const TwoBars& bars, MaterialLaw law) {
  Scene scene = bars.scene;
  scene.material.law = law;
  scene.obstacles.clear();
  scene.self_contact = {};
  scene.skin.reset();
  scene.supports[0].motion.clear();
  scene.supports.push_back(scene.supports[0]);
  scene.supports[1].region.shape = HalfSpace{Vector3d(0.55, 0, 0), Vector3d(-1, 0, 0)};
  scene.supports[0].displacement = Vector3d(0.02, 0.1, 0);
  if (law == MaterialLaw::SmallStrain) scene.volume.reset();
  scene.time.mode = TimeMode::Static;
  scene.time.load_steps = 6;
  return scene;
}

TEST(State, OfStaticsHoldsTheEquilibriaThatTheNextStepStartsFrom) {
  const TwoBars bars("midpoint");
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    const Scene scene = moved_statically(bars, law);
    Simulation whole(scene, bars.network);
    const State middle = after(3, whole).state();
    const int n_newton = whole.report().newton_iterations;
    const State expected = after(3, whole).state();
    Simulation again(scene, bars.network);
    again.set_state(middle);
    EXPECT_LT(apart(after(3, again).state(), expected), 1e-9);
    EXPECT_EQ(again.state().loading->path.last.size(), expected.loading->path.last.size());
    EXPECT_EQ(again.report().newton_iterations, whole.report().newton_iterations - n_newton);
    EXPECT_TRUE(again.has_ended());
    Simulation forgetful(scene, bars.network);
    after(3, forgetful).set_state(middle);
    expect_same(after(3, forgetful).state(), again.state(), "forgotten");
  }
}

TEST(State, OfAnotherBodyIsRefused) {
  const TwoBars bars("rk4");
  Simulation simulation(bars.scene, bars.network);
  State other = simulation.state();
  other.x.conservativeResize(3, 7);
  EXPECT_THROW(simulation.set_state(other), std::runtime_error);
}

using meshing::Change;

const std::vector<Change>& changes() {
  static const std::vector<Change> kAll = [] {
    std::vector<Change> all = meshing::changes_of_values();
    for (const Change& change : meshing::changes_of_obstacles()) all.push_back(change);
    all.push_back({"handle", [](Scene& scene) {
                     scene.handles.push_back({{}, {}, 50, {{0, 0, 0, 0}, {0.1, 0.1, 0, 0}}, 0, {}});
                   }});
    all.push_back({"explicit", [](Scene& scene) { scene.time.integrator = "symplectic_euler"; }});
    all.push_back({"implicit", [](Scene& scene) { scene.time.integrator = "bdf2"; }});
    return all;
  }();
  return kAll;
}

TEST(Relaxation, IsOfAStepByThePapersMethodAndElseOfASecond) {
  TwoBars bars("symplectic_euler");
  bars.scene.collapse.reset();
  Scene paper = bars.scene;
  paper.is_paper = true;
  Simulation plain(bars.scene, bars.network), papers(paper, bars.network);
  const State middle = after(kBefore, plain).state();
  papers.set_state(middle);
  const auto lost = [&](Simulation& simulation) -> Eigen::ArrayXd {
    return (after(1, simulation).state().rest_length.array() / middle.rest_length.array()).log();
  };
  const Eigen::ArrayXd of_step = lost(papers), of_second = lost(plain);
  EXPECT_LT(of_step.minCoeff(), -1e-3);
  EXPECT_LT((of_second - kStep * of_step).matrix().norm(), 1e-9 * of_second.matrix().norm());
}

TwoBars loaded_bars(const std::string& integrator) {
  TwoBars bars(integrator);
  Load side, bag;
  side.region.shape = HalfSpace{Vector3d(0, 0.3, 0.3), Vector3d(-1, 0, 0)};
  bag.is_follower = true;
  bars.scene.loads = {side, bag};
  return bars;
}

TEST(Change, BeforeTheFirstStepIsARunThatBeganSo) {
  for (const char* integrator : {"rk4", "minimising_euler"})
    for (const auto& [name, make] : changes()) {
      const TwoBars bars = loaded_bars(integrator);
      Scene other = bars.scene;
      make(other);
      Simulation began(other, bars.network), changed(bars.scene, bars.network),
          unchanged(bars.scene, bars.network);
      changed.change(other);
      const State expected = after(kBefore, began).state();
      expect_same(after(kBefore, changed).state(), expected, integrator + (" " + name));
      EXPECT_EQ(began.n_steps(), changed.n_steps()) << name;
      EXPECT_GT(apart(after(kBefore, unchanged).state(), expected), 1e-9) << name << " changes nothing";
    }
}

// A body that does not collapse forgets what a collapse would need of its patches.
TEST(Change, ToACollapseIsARunThatBeginsWithItFromTheState) {
  const TwoBars bars = loaded_bars("minimising_euler");
  ASSERT_TRUE(bars.scene.collapse);
  Scene without = bars.scene;
  without.collapse.reset();
  Simulation changed(without, bars.network);
  State middle = after(kBefore, changed).state();
  changed.change(bars.scene);
  middle.ledger = {};
  const State expected = end_of(bars.scene, bars.network, middle, kAfter);
  EXPECT_LT(apart(after(kAfter, changed).state(), expected), 1e-6);
  EXPECT_GT(apart(end_of(without, bars.network, middle, kAfter), expected), 1e-4);
}

TEST(Change, BetweenStepsIsARunThatBeginsSoFromTheState) {
  for (const char* integrator : {"rk4", "implicit_euler", "minimising_euler"})
    for (const auto& [name, make] : changes()) {
      const TwoBars bars = loaded_bars(integrator);
      Scene other = bars.scene;
      make(other);
      Simulation changed(bars.scene, bars.network);
      State middle = after(kBefore, changed).state();
      changed.change(other);
      const State found = after(kAfter, changed).state();
      middle.ledger = {};
      if (name.find("obstacle") != std::string::npos) {  // nothing is known of where it is now
        middle.history.active_set.clear();
        middle.history.clearance.clear();
      }
      const State expected = end_of(other, bars.network, middle, kAfter);
      constexpr double kSolved = 1e-6;  // m
      EXPECT_LT(apart(found, expected), kSolved) << integrator << ' ' << name;
    }
}

TEST(Change, OfGravityTurnsAFallByItsClosedForm) {
  TwoBars bars("midpoint");
  bars.scene.supports.clear();
  bars.scene.self_contact = {};
  bars.scene.volume.reset();
  bars.scene.collapse.reset();
  bars.scene.skin.reset();
  const Vector3d first(0, -9.81, 0), second(4, 2, -1);
  Simulation simulation(bars.scene, bars.network);
  const Matrix3Xd X = simulation.state().x;
  after(20, simulation);
  bars.scene.gravity = second;
  bars.scene.time.step = kStep / 2;
  simulation.change(bars.scene);
  while (!simulation.has_ended()) simulation.advance();
  EXPECT_EQ(simulation.n_done(), 20 + 60);
  EXPECT_NEAR(simulation.state().t, bars.scene.time.end, 1e-12);
  const double s = 0.04, t = bars.scene.time.end - s;
  const Vector3d way = s * s / 2 * first + s * t * first + t * t / 2 * second;
  EXPECT_LT(((simulation.state().x - X).colwise() - way).norm(), 1e-9);
}

TEST(Change, OfEScalesTheEnergyOfTheSameShape) {
  TwoBars bars("symplectic_euler");
  bars.scene.skin.reset();
  Simulation simulation(bars.scene, bars.network);
  const double before = after(kBefore, simulation).snapshot().elastic_energy;
  ASSERT_GT(before, 0);
  bars.scene.material.E *= 3;
  simulation.change(bars.scene);
  EXPECT_NEAR(simulation.snapshot().elastic_energy, 3 * before, 1e-12 * before);
}

TEST(Change, OfGravityInStaticsEndsWhereARunUnderItEnds) {
  TwoBars bars("midpoint");
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    Scene scene = moved_statically(bars, law);
    Simulation changed(scene, bars.network);
    after(3, changed);
    scene.gravity = Vector3d(0, 20, 5);
    changed.change(scene);
    Simulation began(scene, bars.network);
    EXPECT_LT(apart(after(3, changed).state(), after(6, began).state()), 1e-8);
  }
}

/// A scene with two events, kBefore steps and twice as many from the beginning.
TwoBars bars_with_events(const std::string& integrator) {
  TwoBars bars = loaded_bars(integrator);
  Scene first = bars.scene, second;
  first.material.E *= 2;
  second = first;
  second.gravity = Vector3d(3, 1, 2);
  second.obstacles.clear();
  bars.scene.events = {{kBefore * kStep, "", "", std::make_shared<const Scene>(first)},
                       {2 * kBefore * kStep, "", "", std::make_shared<const Scene>(second)}};
  return bars;
}

TEST(Events, AreChangesBeforeTheFirstStepThatBeginsThen) {
  for (const char* integrator : {"rk4", "bdf2", "minimising_euler"}) {
    const TwoBars bars = bars_with_events(integrator);
    TwoBars plain = loaded_bars(integrator);
    Simulation told(bars.scene, bars.network), changed(plain.scene, plain.network);
    after(kBefore, changed).change(*bars.scene.events[0].after);
    after(kBefore, changed).change(*bars.scene.events[1].after);
    const State expected = after(2, changed).state();
    expect_same(after(2 * kBefore + 2, told).state(), expected, integrator);
    EXPECT_EQ(told.state().n_events, 2);
  }
}

TEST(Events, AreKnownToAStateAndToWhatIsSaved) {
  for (const char* integrator : {"rk4", "minimising_euler"}) {
    const TwoBars bars = bars_with_events(integrator);
    Simulation whole(bars.scene, bars.network);
    const std::string saved = after(kBefore + 2, whole).saved();
    const State expected = after(kBefore, whole).state();
    Simulation again(bars.scene, bars.network);
    again.restore(saved);
    expect_same(after(kBefore, again).state(), expected, integrator);
    again.restore(saved);  // back over the second event
    expect_same(after(kBefore, again).state(), expected, integrator);
  }
}

TEST(Events, DoWorkThatTheBalanceOfEnergyHas) {
  TwoBars bars("midpoint");
  bars.scene.skin.reset();
  Scene softer = bars.scene;
  softer.material.E /= 4;
  bars.scene.events = {{kBefore * kStep, "", "", std::make_shared<const Scene>(softer)}};
  Simulation simulation(bars.scene, bars.network);
  const double elastic = after(kBefore, simulation).snapshot().elastic_energy;
  ASSERT_GT(elastic, 0);
  const auto work = [&] { return after(1, simulation).state().ledger.flows.events; };
  EXPECT_NEAR(work(), -0.75 * elastic, 1e-9 * elastic);
  EXPECT_NEAR(work(), -0.75 * elastic, 1e-9 * elastic) << "once";
}

TEST(Events, InStaticsComeAtTheirLoadFactor) {
  const TwoBars bars("midpoint");
  Scene scene = moved_statically(bars, MaterialLaw::NeoHookean), other = scene;
  other.gravity = Vector3d(0, 20, 5);
  scene.events = {{0.5, "", "", std::make_shared<const Scene>(other)}};
  Simulation told(scene, bars.network),
      changed(moved_statically(bars, MaterialLaw::NeoHookean), bars.network);
  after(3, changed).change(other);
  expect_same(after(6, told).state(), after(3, changed).state(), "statics");
}

TEST(Events, ThatARunCannotObeyAreRefusedBeforeIt) {
  TwoBars bars("rk4");
  Scene other = bars.scene;
  other.material.rho = 1;
  bars.scene.events = {{0, "", "", std::make_shared<const Scene>(other)}};
  bars.scene.places["events.0.key"] = "a.toml:3";
  try {
    const Simulation simulation(bars.scene, bars.network);
    ADD_FAILURE();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "a.toml:3: material.rho changes in a run, expected a new run");
  }
}

TEST(Handles, CarryAFreeBodyInStaticsWithoutStrain) {
  TwoBars bars("midpoint");
  Scene scene = moved_statically(bars, MaterialLaw::NeoHookean);
  scene.supports.clear();
  scene.gravity.reset();
  scene.volume.reset();
  scene.collapse.reset();
  scene.handles = {{{}, {}, 100, {{0, 0, 0, 0}, {1, 0.3, -0.2, 0.1}}, 0, {}}};
  Simulation simulation(scene, bars.network);
  while (!simulation.has_ended()) simulation.advance();
  EXPECT_EQ(simulation.status(), Status::Ok);
  const Matrix3Xd u = displacement(simulation.model(), simulation.state());
  EXPECT_LT((u.colwise() - Vector3d(0.3, -0.2, 0.1)).norm(), 1e-8);
}

TEST(Change, OfWhatARunIsBuiltOnIsRefusedAndChangesNothing) {
  const TwoBars bars("rk4");
  Simulation simulation(bars.scene, bars.network);
  const auto refusal = [&](const std::function<void(Scene&)>& make) -> std::string {
    Scene other = bars.scene;
    other.material.E *= 2;
    make(other);
    try {
      simulation.change(other);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(refusal([](Scene& scene) { scene.material.rho = 1; }),
            "material.rho changes in a run, expected a new run");
  EXPECT_EQ(refusal([](Scene& scene) { scene.loads.emplace_back(); }).substr(0, 6), "loads.");
  EXPECT_EQ(refusal([](Scene& scene) { scene.material.law = MaterialLaw::SmallStrain; }),
            "material.law = small_strain in a run that began with another one");
  Simulation untouched(bars.scene, bars.network);
  expect_same(after(3, simulation).state(), after(3, untouched).state(), "refused");
}

}  // namespace
}  // namespace testbed::massspring
