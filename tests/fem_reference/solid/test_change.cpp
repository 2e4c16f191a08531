// A run of the reference goes on under other values as one that began with them.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <functional>
#include <stdexcept>

#include "meshing/scene/surface_problem.h"
#include "tests/fem_reference/solid/bars.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::VectorXd;

using meshing::Change;

const std::vector<Change>& changes() {
  static const std::vector<Change> kAll = [] {
    std::vector<Change> all = meshing::changes_of_values();
    all.push_back({"fading collapse", [](Scene& scene) {
                     scene.collapse->surface = false;
                     scene.collapse->depth = 0.1;
                   }});
    return all;
  }();
  return kAll;
}

const Change& change_of(const std::string& name) {
  return *std::find_if(changes().begin(), changes().end(), [&](const Change& c) { return c.name == name; });
}

const std::vector<Change>& changes_of_contact() {
  static const std::vector<Change> kAll = [] {
    std::vector<Change> all = changes();
    for (const Change& change : meshing::changes_of_obstacles()) all.push_back(change);
    all.push_back({"another integrator", [](Scene& scene) {
                     std::string& name = scene.reference.integrator;
                     name = name == "minimising_euler" ? "generalised_alpha" : "minimising_euler";
                   }});
    return all;
  }();
  return kAll;
}

const std::vector<Change>& changes_of_integrators() {
  static const std::vector<Change> kAll = [] {
    std::vector<Change> all;
    for (const Scheme& scheme : schemes())
      all.push_back({scheme.name, [&scheme](Scene& scene) { scene.reference.integrator = scheme.name; }});
    all.push_back({"spectral radius", [](Scene& scene) {
                     scene.reference.integrator = "generalised_alpha";
                     scene.reference.spectral_radius = 0.5;
                   }});
    return all;
  }();
  return kAll;
}

Bars loaded_bars(const std::string& integrator) {
  Bars bars(integrator);
  Load side, bag;
  side.region.shape = HalfSpace{Vector3d(0, 0.3, 0.3), Vector3d(-1, 0, 0)};
  bag.is_follower = true;
  bars.scene.loads = {side, bag};
  bars.scene.material.damping_ratio = 0.05;
  return bars;
}

/// The state in which a run under another scene begins where one has come to at t: its acceleration balances the
/// forces that act there, and friction is that of the way there.
State begun_with(State state, double t, Bars& bars, const Scene& scene) {
  Simulation placed = bars.simulation_of(scene);
  MotionState& motion = state.motion;
  const meshing::SurfaceMemories memories = motion.surface;
  motion.begun = t;
  motion.n_steps = 0;
  placed.set_state(state);  // for the lengths of a collapse
  const ElasticSolid& solid = placed.solid();
  const Matrix3Xd u = motion.u.reshaped(3, solid.X().cols()), v = motion.v.reshaped(3, u.cols());
  const double h = placed.step();
  for (const auto& energy : solid.surface()) energy->begin_step(t - h, h, solid.X() + u - h * v);
  remember(memories, solid.surface());
  Matrix3Xd force;
  solid.find_forces(u, 1, force);
  const bool is_explicit = placed.mass() == MassMatrix::Lumped;
  Eigen::MatrixXd M = solid.mass(placed.mass());
  VectorXd balance = solid.load() - force.reshaped();
  if (!is_explicit) balance -= placed.damping() * (M * motion.v);
  for (const ConstrainedComponent& c : solid.constrained()) {
    if (!holds_at(scene.supports[c.support], t)) continue;
    const int i = 3 * c.node + c.component;
    M.row(i).setZero();
    M.col(i).setZero();
    M(i, i) = 1;
    balance(i) = 0;  // supports move evenly
  }
  motion.a = M.ldlt().solve(balance);
  motion.force = force.reshaped();
  motion.ledger.begin(placed.integrator()->kinetic_energy(), placed.integrator()->elastic_energy(),
                      solid.surface(), solid.X() + u, 0);
  return state;
}

void expect_as_begun_between_steps(Bars& bars, const Change& change, double tolerance) {
  Scene other = bars.scene;
  change.make(other);
  Simulation changed = bars.simulation(), fresh = bars.simulation_of(other);
  const State middle = after(kBefore, changed).state();
  const double t = changed.integrator()->t();
  const Snapshot before = changed.snapshot();
  const int n_newton = changed.integrator()->counts().newton_iterations;
  changed.change(other);
  EXPECT_EQ(changed.snapshot().u, before.u) << change.name;
  EXPECT_EQ(changed.snapshot().time, before.time) << change.name;
  EXPECT_EQ(changed.integrator()->counts().newton_iterations, n_newton) << change.name;
  fresh.set_state(begun_with(middle, t, bars, other));
  EXPECT_EQ(changed.n_steps(), fresh.n_steps()) << change.name;
  EXPECT_LT(apart(after(kAfter, changed), after(kAfter, fresh)), tolerance)
      << bars.scene.reference.integrator << ' ' << change.name;
  EXPECT_NEAR(changed.integrator()->t(), t + kAfter * other.time.step, 1e-12) << change.name;
}

TEST(Change, BeforeTheFirstStepIsARunThatBeganSo) {
  const auto expect_as_begun = [](Bars& bars, const Change& change) {
    Scene other = bars.scene;
    change.make(other);
    Simulation began = bars.simulation_of(other), changed = bars.simulation(), unchanged = bars.simulation();
    changed.change(other);
    after(kAfter, began);
    EXPECT_EQ(apart(after(kAfter, changed), began), 0)
        << bars.scene.reference.integrator << ' ' << change.name;
    EXPECT_EQ(began.n_steps(), changed.n_steps()) << change.name;
    EXPECT_EQ(began.integrator()->ledger().gain(), changed.integrator()->ledger().gain()) << change.name;
    EXPECT_GT(apart(after(kAfter, unchanged), began), 1e-9) << change.name << " changes nothing";
  };
  for (const char* integrator : {"generalised_alpha", "minimising_euler"})
    for (const Change& change : changes_of_contact()) {
      Bars bars = loaded_bars(integrator);
      expect_as_begun(bars, change);
    }
}

TEST(Change, OfContactBetweenStepsIsARunThatBeginsSoFromTheState) {
  constexpr double kSolved = 1e-7;  // m
  for (const char* integrator : {"generalised_alpha", "minimising_euler"})
    for (const Change& change : changes_of_contact()) {
      Bars bars = loaded_bars(integrator);
      expect_as_begun_between_steps(bars, change, kSolved);
    }
}

TEST(Change, BetweenStepsOfEverySchemeIsARunThatBeginsSoFromTheState) {
  constexpr double kSolved = 1e-9;  // m
  for (const Scheme& scheme : schemes())
    for (const std::vector<Change>* kind : {&changes(), &changes_of_integrators()})
      for (const Change& change : *kind) {
        Bars bars = loaded_bars(scheme.name);
        bars.remove_contact();
        expect_as_begun_between_steps(bars, change, kSolved);
      }
}

TEST(Change, MayComeBeforeAndAfterASupportEnds) {
  for (const Scheme& scheme : schemes())
    for (const int n_held : {kBefore - 5, kBefore, kBefore + 5}) {
      Bars bars = loaded_bars(scheme.name);
      bars.remove_contact();
      bars.scene.supports[0].end = kStep * n_held;
      expect_as_begun_between_steps(bars, change_of("E"), 1e-9);
    }
}

// Without a curve the volume is kept as a collapse leaves it, and as it was at rest where nothing collapses.
TEST(Change, OfCollapseChangesTheVolumeThatIsKept) {
  Bars bars = loaded_bars("minimising_euler");
  bars.scene.volume->target.clear();
  const auto no_collapse = [](Scene& scene) { scene.collapse.reset(); };
  expect_as_begun_between_steps(bars, {"no collapse", no_collapse}, 1e-7);
}

TEST(Change, IsUndoneByAStateFromBeforeIt) {
  Bars bars("minimising_euler");
  bars.remove_contact();
  const Scene collapsing = bars.scene;
  bars.scene.collapse.reset();
  Simulation simulation = bars.simulation();
  const State before = after(kAfter, simulation).state();
  const double energy = simulation.snapshot().elastic_energy;
  simulation.change(collapsing);
  after(kAfter, simulation);
  simulation.change(bars.scene);
  simulation.set_state(before);
  EXPECT_NEAR(simulation.snapshot().elastic_energy, energy, 1e-12 * energy);
}

TEST(Change, OfGravityTurnsAFallByItsClosedForm) {
  const Vector3d first(0, -9.81, 0), second(4, 2, -1);
  for (const char* integrator : {"generalised_alpha", "central_differences"}) {
    Bars bars(integrator);
    bars.remove_contact();
    bars.scene.supports.clear();
    bars.scene.collapse.reset();
    Simulation simulation = bars.simulation();
    after(20, simulation);
    bars.scene.gravity = second;
    bars.scene.time.step = kStep / 2;
    simulation.change(bars.scene);
    while (!simulation.has_ended()) simulation.advance();
    EXPECT_EQ(simulation.n_done(), 20 + 60);
    const double end = bars.scene.time.end, s = 0.04, t = end - s;
    EXPECT_NEAR(simulation.snapshot().time, end, 1e-12);
    const Vector3d way = s * s / 2 * first + s * t * first + t * t / 2 * second;
    EXPECT_LT((simulation.snapshot().u.colwise() - way).norm(), 1e-9) << integrator;
  }
}

TEST(Change, OfEScalesTheEnergyOfTheSameShape) {
  for (const Scheme& scheme : schemes()) {
    Bars bars(scheme.name);
    bars.remove_contact();
    Simulation simulation = bars.simulation();
    const double before = after(kBefore, simulation).snapshot().elastic_energy;
    ASSERT_GT(before, 0);
    bars.scene.material.E *= 3;
    simulation.change(bars.scene);
    EXPECT_NEAR(simulation.snapshot().elastic_energy, 3 * before, 1e-11 * before);
  }
}

TEST(Change, BeginsTheBalanceOfEnergyAnewButWhereCollapseAloneChanges) {
  Bars bars("minimising_euler");
  bars.remove_contact();
  Simulation simulation = bars.simulation();
  const double before = column_of(after(kBefore, simulation), "work_of_loads");
  ASSERT_NE(before, 0);
  for (const char* name : {"depletion", "no collapse", "pivot", "another pivot"}) {
    Scene other = bars.scene;
    change_of(name).make(other);
    simulation.change(other);
    EXPECT_EQ(column_of(simulation, "work_of_loads"), before) << name;
  }
  simulation.change(bars.scene);
  bars.scene.gravity = Vector3d(1, 2, 3);
  simulation.change(bars.scene);
  EXPECT_EQ(column_of(simulation, "work_of_loads"), 0);
}

// The floor comes to where the body was at first, but is no longer.
TEST(Change, OfAnObstacleMayPutItWhereTheBodyBegan) {
  const Vector3d velocity(0, 1, 0);
  Bars bars("minimising_euler");
  bars.remove_contact();
  bars.scene.supports.clear();
  bars.scene.gravity.reset();
  bars.scene.collapse.reset();
  bars.scene.initial.emplace_back().velocity = velocity;
  Simulation simulation = bars.simulation();
  after(kBefore, simulation);
  Obstacle floor;
  floor.shape = HalfSpace{Vector3d(0, 0.03, 0), Vector3d(0, 1, 0)};
  bars.scene.obstacles = {floor};
  EXPECT_THROW(bars.simulation(), std::runtime_error);
  simulation.change(bars.scene);
  const Snapshot last = after(kAfter, simulation).snapshot();
  EXPECT_LT((last.u.colwise() - velocity * last.time).norm(), 1e-9);
}

/// A bar is clamped at one end, the other bar and its end move. It collapses so little that a change of it is no more
/// than a load step can follow.
Scene moved_statically(const Bars& bars, MaterialLaw law) {
  Scene scene = bars.scene;
  scene.material.law = law;
  scene.supports[0].motion.clear();
  scene.supports.push_back(scene.supports[0]);
  scene.supports[1].region.shape = HalfSpace{Vector3d(0.55, 0, 0), Vector3d(-1, 0, 0)};
  scene.supports[0].displacement = Vector3d(0.02, 0.1, 0);
  scene.time.mode = TimeMode::Static;
  scene.time.load_steps = 6;
  scene.collapse->coefficient = 0.1;
  return scene;
}

TEST(Change, InStaticsEndsWhereARunUnderItEnds) {
  Bars bars("generalised_alpha");
  bars.remove_contact();
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
    for (const Change& change : changes()) {
      if (change.name.find("pressure") != std::string::npos || change.name == "step") continue;
      const Scene scene = moved_statically(bars, law);
      Scene other = scene;
      change.make(other);
      Simulation changed = bars.simulation_of(scene), began = bars.simulation_of(other);
      const Snapshot before = after(3, changed).snapshot();
      changed.change(other);
      EXPECT_EQ(changed.snapshot().u, before.u) << change.name;
      EXPECT_EQ(changed.snapshot().elastic_energy, before.elastic_energy) << change.name;
      EXPECT_LT(apart(after(3, changed), after(6, began)), 1e-9) << name_of(law) << ' ' << change.name;
      EXPECT_TRUE(changed.has_ended());
      EXPECT_NEAR(changed.snapshot().elastic_energy, began.snapshot().elastic_energy,
                  1e-7 * began.snapshot().elastic_energy);
    }
}

TEST(Change, OfWhatARunIsBuiltOnIsRefusedByNameAndChangesNothing) {
  Bars bars("minimising_euler");
  Simulation simulation = bars.simulation(), untouched = bars.simulation();
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
  EXPECT_EQ(refusal([](Scene& scene) { scene.reference.degree = 2; }),
            "reference.degree changes in a run, expected a new run");
  EXPECT_EQ(refusal([](Scene& scene) { scene.reference.refine = 1; }),
            "reference.refine changes in a run, expected a new run");
  EXPECT_EQ(refusal([](Scene& scene) { scene.surface.scale = 2; }),
            "surface.scale changes in a run, expected a new run");
  EXPECT_EQ(refusal([](Scene& scene) { scene.reference.integrator = "central_differences"; }).substr(0, 50),
            "the reference cannot go on with volume.coefficient");
  EXPECT_NE(refusal([](Scene& scene) { scene.reference.integrator = "midpoint"; }).find("no such scheme"),
            std::string::npos);
  EXPECT_NE(refusal([](Scene& scene) { scene.reference.spectral_radius = 0.5; }).find("no such parameter"),
            std::string::npos);
  EXPECT_EQ(apart(after(3, simulation), after(3, untouched)), 0) << "refused";
}

}  // namespace
}  // namespace testbed::fem
