// A scene's solid in motion: how it begins, and what its supports hold.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>

#include "fem_reference/solid/simulation.h"
#include "tests/meshing/box_tets.h"
#include "tests/meshing/rolling.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

const Vector3d kVelocity(3, -1, 2), kSpin(0.5, 2, -1);

/// A box of 1 m x 0.5 m x 0.5 m that nothing holds.
struct FreeBox {
  TetMesh mesh = box_tets(2, 1, 1, 0.5);
  Scene scene;
  StageTimer timer;
  FreeBox() {
    scene.material = {1e6, 0.3, 1000, 0};
    scene.time.mode = TimeMode::Dynamic;
    scene.time.end = 0.1;
    scene.time.step = 1e-3;
    scene.initial.emplace_back();
  }
  Simulation simulation() { return {scene, {mesh.X, mesh.F}, mesh, timer}; }
};

Vector3d angular_momentum(const Simulation& simulation) {
  const Matrix3Xd& X = simulation.solid().X();
  const Eigen::VectorXd p = simulation.solid().mass() * simulation.integrator()->v();
  const Matrix3Xd x = X + simulation.integrator()->u().reshaped(3, X.cols());
  Vector3d sum = Vector3d::Zero();
  for (Eigen::Index i = 0; i < x.cols(); ++i) sum += x.col(i).cross(p.segment<3>(3 * i));
  return sum;
}

TEST(InitialMotion, CarriesAFreeBodyAtItsVelocity) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
    for (const int degree : {1, 2}) {
      box.scene.material.law = law;
      box.scene.reference.degree = degree;
      Simulation simulation = box.simulation();
      while (!simulation.has_ended()) simulation.advance();
      const Snapshot snapshot = simulation.snapshot();
      const Matrix3Xd expected = (kVelocity * snapshot.time).replicate(1, snapshot.u.cols());
      EXPECT_NEAR(snapshot.time, box.scene.time.end, 1e-12);
      EXPECT_LT((snapshot.u - expected).norm(), 1e-9 * expected.norm()) << degree;
    }
}

// Average acceleration keeps angular momentum at finite strain to the square of the step.
TEST(InitialMotion, SpinsAStiffBodyThatKeepsItsAngularMomentum) {
  FreeBox box;
  box.scene.initial[0].spin = kSpin;
  box.scene.material.E = 1e8;
  double lost[2] = {};
  for (const int divided : {1, 2}) {
    box.scene.time.step = 2e-3 / divided;
    Simulation simulation = box.simulation();
    const Vector3d before = angular_momentum(simulation);
    while (!simulation.has_ended()) simulation.advance();
    lost[divided - 1] = (angular_momentum(simulation) - before).norm() / before.norm();
    const Matrix3Xd& X = simulation.solid().X();
    const Vector3d centre(0.5, 0.25, 0.25);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(kSpin.norm() * simulation.integrator()->t(), kSpin.normalized()).matrix();
    const Matrix3Xd turned = (turn * (X.colwise() - centre)).colwise() + centre;
    EXPECT_LT((X + simulation.snapshot().u - turned).norm(), 0.1 * (turned - X).norm());
  }
  EXPECT_LT(lost[1], 1e-4);
  EXPECT_LT(lost[1], lost[0] / 3);
}

TEST(InitialMotion, IsOverruledBySupports) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  Support face;
  face.region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  face.fixed = {{true, false, true}};
  box.scene.supports = {face};
  Simulation simulation = box.simulation();
  const auto velocity = [&](int node) { return Vector3d(simulation.integrator()->v().segment<3>(3 * node)); };
  const int constrained = simulation.solid().constrained().at(0).node,
            free = static_cast<int>(box.mesh.X.cols()) - 1;
  EXPECT_EQ(velocity(constrained), Vector3d(0, kVelocity.y(), 0));
  EXPECT_EQ(velocity(free), kVelocity);
  for (int n = 0; n < 10; ++n) simulation.advance();
  for (const ConstrainedComponent& h : simulation.solid().constrained()) {
    EXPECT_EQ(simulation.snapshot().u(h.component, h.node), 0);
    EXPECT_EQ(velocity(h.node)(h.component), 0);
  }
  EXPECT_GT(simulation.snapshot().u.col(free).norm(), 0);
}

TEST(InitialMotion, IsAlongTheScenesAxesThoughSupportsAreOblique) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  Support face;
  face.region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  face.normal = Vector3d(1, 2, 0);
  box.scene.supports = {face};
  const Simulation simulation = box.simulation();
  const Snapshot snapshot = simulation.snapshot();
  const int constrained = simulation.solid().constrained().at(0).node;
  const Vector3d n = face.normal->normalized();
  EXPECT_LT((snapshot.fields[0].values.col(constrained) - (kVelocity - n.dot(kVelocity) * n)).norm(), 1e-12);
  EXPECT_LT((snapshot.fields[0].values.rightCols<1>() - kVelocity).norm(), 1e-12);
}

TEST(Supports, HoldAlongAnyDirectionAsTheyDoAlongAxes) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(M_PI / 4, Vector3d(1, 2, -1).normalized()).matrix();
  const auto last_of = [](FreeBox& box) {
    Simulation simulation = box.simulation();
    while (!simulation.has_ended()) simulation.advance();
    EXPECT_EQ(simulation.status(), Status::Ok);
    return std::pair(simulation.X(), simulation.snapshot().u);
  };
  for (const TimeMode mode : {TimeMode::Static, TimeMode::Dynamic})
    for (const Scheme& scheme : schemes())
      for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
        for (const bool is_axis : {false, true}) {
          FreeBox box;
          box.scene.time.mode = mode;
          box.scene.time.step = 1e-4;
          box.scene.time.end = 2e-3;
          box.scene.reference.integrator = scheme.name;
          box.scene.material.law = law;
          FreeBox other = box;
          other.mesh.X = turn * box.mesh.X;
          const Vector3d constrained = is_axis ? Vector3d(0, 1, 0) : Vector3d(0, 0, 1);
          other.scene = rolling(box.scene, turn, constrained, is_axis);
          box.scene = rolling(box.scene, Eigen::Matrix3d::Identity(), constrained, is_axis);
          Support& roller = box.scene.supports[1];
          roller.normal.reset();
          roller.along.reset();
          roller.fixed = {{is_axis, false, true}};
          const auto [X, u] = last_of(box);
          const auto [other_X, other_u] = last_of(other);
          EXPECT_LT((other_X - turn * X).norm(), 1e-12 * X.norm());
          EXPECT_LT((other_u - turn * u).norm(), 1e-7 * u.norm()) << is_axis;
        }
}

TEST(Supports, LetABodySlideDownAnInclineAtTheAccelerationOfAPoint) {
  FreeBox box;
  const Vector3d normal = Vector3d(1, 0, 2).normalized(), gravity(0, 0, -9.81);
  const Vector3d downhill = gravity - gravity.dot(normal) * normal;
  box.scene.initial.clear();
  box.scene.gravity = gravity;
  Support base;
  base.region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(0, 0, 1)};
  base.normal = normal;
  box.scene.supports = {base};
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    box.scene.material.law = law;
    Simulation simulation = box.simulation();
    while (!simulation.has_ended()) simulation.advance();
    const Matrix3Xd u = simulation.snapshot().u;
    const Matrix3Xd p = (simulation.solid().mass() * Eigen::VectorXd(u.reshaped())).reshaped(3, u.cols());
    const Vector3d way = 3 * p.rowwise().sum() / simulation.solid().mass().sum();
    const double t = simulation.snapshot().time;
    EXPECT_NEAR(way.dot(downhill), downhill.squaredNorm() * t * t / 2, 1e-7);
    EXPECT_NEAR(way.dot(normal.cross(downhill)), 0, 1e-7);
  }
}

TEST(Supports, LetGoAtTheirEnd) {
  constexpr double kEnd = 0.04, kGravity = 9.81;
  for (const Scheme& scheme : schemes())
    for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
      FreeBox box;
      box.scene.initial.clear();
      box.scene.gravity = Vector3d(0, 0, -kGravity);
      box.scene.reference.integrator = scheme.name;
      box.scene.material.law = law;
      box.scene.reference.degree = 1;  // all nodes are of the surface
      box.scene.supports.resize(1);
      box.scene.supports[0].fixed = {{false, false, true}};
      box.scene.supports[0].end = kEnd;
      Simulation simulation = box.simulation();
      while (!simulation.has_ended()) {
        simulation.advance();
        const double t = simulation.integrator()->t(), fall = std::max(0., t - kEnd);
        const Matrix3Xd u = simulation.snapshot().u;
        const double late = scheme.name == "minimising_euler" ? box.scene.time.step : 0;  // implicit Euler
        const Matrix3Xd expected =
            Vector3d(0, 0, -kGravity * fall * (fall + late) / 2).replicate(1, u.cols());
        ASSERT_LT((u - expected).norm(), 1e-9) << t;
      }
      EXPECT_NEAR(simulation.integrator()->t(), box.scene.time.end, 1e-12);
    }
}

TEST(Supports, LetGoOfNodesThatObstaclesThenHold) {
  constexpr double kFloor = -0.01;
  FreeBox box;
  box.scene.initial.clear();
  box.scene.gravity = Vector3d(0, 0, -9.81);
  box.scene.material.law = MaterialLaw::NeoHookean;
  box.scene.reference.degree = 1;
  box.scene.reference.integrator = "minimising_euler";
  box.scene.supports.resize(1);
  box.scene.supports[0].end = 0.01;
  box.scene.obstacles.emplace_back().shape = HalfSpace{Vector3d(0, 0, kFloor), Vector3d::UnitZ()};
  Simulation simulation = box.simulation();
  while (!simulation.has_ended()) simulation.advance();
  EXPECT_EQ(simulation.status(), Status::Ok);
  const double lowest = (simulation.X() + simulation.snapshot().u).row(2).minCoeff();
  EXPECT_GT(lowest, kFloor);
  EXPECT_LT(lowest, 0.5 * kFloor) << "it has fallen";
}

// As nodes on a plane of symmetry do.
TEST(Supports, LeaveNodesToObstaclesThatTheyHoldAlongSomeAxesAlone) {
  constexpr double kFloor = -0.01;
  for (const bool is_y : {false, true}) {
    FreeBox box;
    box.scene.initial[0].velocity = Vector3d(0, 0, -1);
    box.scene.material.law = MaterialLaw::NeoHookean;
    box.scene.reference.degree = 1;
    box.scene.reference.integrator = "minimising_euler";
    box.scene.time.end = 0.03;
    box.scene.supports.resize(1);
    box.scene.supports[0].fixed = {{true, is_y, false}};
    box.scene.obstacles.emplace_back().shape = HalfSpace{Vector3d(0, 0, kFloor), Vector3d::UnitZ()};
    Simulation simulation = box.simulation();
    double lowest = 0;
    while (!simulation.has_ended()) {
      simulation.advance();
      lowest = std::min(lowest, (simulation.X() + simulation.snapshot().u).row(2).minCoeff());
    }
    EXPECT_EQ(simulation.status(), Status::Ok);
    EXPECT_GT(lowest, kFloor) << is_y;
    EXPECT_LT(lowest, 0.5 * kFloor) << "it has come there";
  }
}

/// Clamped at one end, which moves; the other end is free from kEnd on. Gravity and a follower pressure act.
FreeBox moved_box(const Scheme& scheme, MaterialLaw law) {
  FreeBox box;
  box.scene.initial.clear();
  box.scene.gravity = Vector3d(1, -9.81, 0);
  box.scene.material.law = law;
  box.scene.reference.integrator = scheme.name;
  box.scene.reference.degree = 1;
  if (scheme.has_spectral_radius) box.scene.reference.spectral_radius = 0.5;
  box.scene.supports.resize(2);
  box.scene.supports[0].region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  box.scene.supports[0].motion = {{0, 0, 0, 0}, {0.1, 0.05, 0, 0}};
  box.scene.supports[1].region.shape = HalfSpace{Vector3d(1, 0, 0), Vector3d(-1, 0, 0)};
  box.scene.supports[1].end = 0.02;
  box.scene.loads.resize(1);
  box.scene.loads[0].pressure = 1e4;
  box.scene.loads[0].is_follower = law == MaterialLaw::NeoHookean;
  return box;
}

Simulation& after(int n_steps, Simulation& simulation) {
  for (int n = 0; n < n_steps; ++n) EXPECT_EQ(simulation.advance(), Status::Ok);
  return simulation;
}

void expect_same(const Simulation& found, const Simulation& expected, double tolerance) {
  const Snapshot a = found.snapshot(), b = expected.snapshot();
  EXPECT_EQ(a.time, b.time);
  EXPECT_EQ(found.n_done(), expected.n_done());
  EXPECT_LE((a.u - b.u).norm(), tolerance * b.u.norm());
  EXPECT_LE(std::abs(a.elastic_energy - b.elastic_energy), tolerance * b.elastic_energy);
  EXPECT_EQ(a.strains.size(), b.strains.size());
}

TEST(State, OfAMotionIsAllThatDecidesHowItGoesOn) {
  constexpr int kAfter = 10;
  for (const Scheme& scheme : schemes())
    for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
      for (const int n_before : {19, 20, 21}) {
        FreeBox box = moved_box(scheme, law);
        Simulation whole = box.simulation(), again = box.simulation(), forgetful = box.simulation();
        const State middle = after(n_before, whole).state();
        after(kAfter, whole);
        again.set_state(middle);
        after(kAfter, again);
        const bool keeps_factors = !scheme.is_explicit() && law == MaterialLaw::NeoHookean;
        constexpr double kSolved = 1e-8;  // Newton's method ends at 1e-10 of the forces
        expect_same(again, whole, keeps_factors ? kSolved : 0);
        after(n_before, forgetful).set_state(middle);
        expect_same(after(kAfter, forgetful), again, 0);
        if (scheme.name == "minimising_euler") continue;  // to which accelerations are a first guess
        State still = middle;
        still.motion.a.setZero();
        again.set_state(still);
        EXPECT_GT((after(kAfter, again).snapshot().u - whole.snapshot().u).norm(),
                  1e-6 * whole.snapshot().u.norm())
            << "accelerations decide";
      }
}

TEST(State, OfStaticsIsAllThatDecidesHowTheyGoOn) {
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
    for (const bool is_proportional : {false, true}) {
      FreeBox box = moved_box(schemes()[0], law);
      box.scene.supports.resize(1);
      box.scene.supports[0].motion = {{0, 0, 0, 0}, {1, 0.05, 0, 0}};
      if (is_proportional) box.scene.supports[0].motion.clear();
      box.scene.time.mode = TimeMode::Static;
      box.scene.time.load_steps = 6;
      Simulation whole = box.simulation(), again = box.simulation();
      const State middle = after(3, whole).state();
      again.set_state(middle);
      expect_same(again, whole, 0);
      after(3, whole);
      after(3, again);
      expect_same(again, whole, 1e-8);
      EXPECT_EQ(again.state().statics->path.last.size(), whole.state().statics->path.last.size());
      EXPECT_TRUE(again.has_ended());
    }
}

TEST(State, OfTheOtherModeIsRefused) {
  FreeBox box = moved_box(schemes()[0], MaterialLaw::SmallStrain), statics = box;
  statics.scene.time.mode = TimeMode::Static;
  statics.scene.supports.resize(1);
  Simulation motion = box.simulation();
  EXPECT_THROW(motion.set_state(statics.simulation().state()), std::runtime_error);
}

/// A column of the ledger (J).
double column_of(const Simulation& simulation, const std::string& name) {
  for (const auto& [column, value] : simulation.snapshot().ledger)
    if (column == name) return value;
  throw std::runtime_error("no column " + name);
}

double stored(const Simulation& simulation) {
  const Snapshot snapshot = simulation.snapshot();
  return snapshot.kinetic_energy + snapshot.elastic_energy;
}

Support held_face() {
  Support face;
  face.region.shape = HalfSpace{Vector3d(0.05, 0, 0), Vector3d(1, 0, 0)};
  return face;
}

TEST(Ledger, ClosesToRoundingWhereTheSchemeConserves) {
  for (const bool is_free : {true, false}) {
    FreeBox box;
    box.scene.initial.clear();
    box.scene.gravity = Vector3d(0, -9.81, 0);
    box.scene.material.law = MaterialLaw::SmallStrain;
    if (!is_free) box.scene.supports = {held_face()};
    Simulation simulation = box.simulation();
    double largest = 0;
    while (!simulation.has_ended()) {
      simulation.advance();
      largest = std::max(largest, stored(simulation));
      ASSERT_NEAR(stored(simulation), column_of(simulation, "work_of_loads"), 1e-9 * largest);
      ASSERT_NEAR(column_of(simulation, "lost_to_scheme"), 0, 1e-9 * largest);
    }
    const double m = 250, t = 0.1;
    if (is_free) {
      EXPECT_NEAR(stored(simulation), m * std::pow(9.81 * t, 2) / 2, 1e-6 * largest);
    }
    EXPECT_EQ(simulation.status(), Status::Ok);
  }
}

TEST(Ledger, ReadsWhatDampingTakesOfARigidMotionAndOfAnOscillator) {
  FreeBox box;
  box.scene.material.damping = 5;
  box.scene.initial[0].velocity = Vector3d(1, 0, 0);
  {
    Simulation simulation = box.simulation();
    while (!simulation.has_ended()) simulation.advance();
    const double lost = 250. / 2 * (1 - std::exp(-2 * 5 * 0.1));
    EXPECT_NEAR(column_of(simulation, "lost_to_damping"), lost, 1e-4 * lost);
    EXPECT_NEAR(column_of(simulation, "lost_to_scheme"), 0, 1e-4 * lost);
  }
  box.scene.material.law = MaterialLaw::SmallStrain;
  box.scene.supports = {held_face()};
  for (const bool is_by_stiffness : {false, true}) {
    box.scene.material.damping = is_by_stiffness ? 0 : 5;
    box.scene.material.stiffness_damping = is_by_stiffness ? 5e-3 : 0;
    Simulation simulation = box.simulation();
    const double before = stored(simulation);
    while (!simulation.has_ended()) simulation.advance();
    const double lost = before - stored(simulation);
    EXPECT_GT(lost, 0.3 * before);
    EXPECT_NEAR(column_of(simulation, "lost_to_damping"), lost, (is_by_stiffness ? 0.2 : 0.02) * lost);
  }
}

TEST(Ledger, ReadsTheWorkOfASupportThatMoves) {
  FreeBox box;
  box.scene.initial.clear();
  box.scene.material.law = MaterialLaw::SmallStrain;
  Support end;
  end.region.shape = HalfSpace{Vector3d(0.95, 0, 0), Vector3d(-1, 0, 0)};
  end.displacement = Vector3d(0.01, 0, 0);
  box.scene.supports = {held_face(), end};
  for (const double damping : {0., 100.}) {
    box.scene.material.damping = damping;
    Simulation simulation = box.simulation();
    const double before = stored(simulation);  // supports move at once
    while (!simulation.has_ended()) simulation.advance();
    const double work = column_of(simulation, "work_of_supports");
    EXPECT_GT(work, 0);
    EXPECT_NEAR(stored(simulation) + column_of(simulation, "lost_to_damping") - before, work, 0.02 * work);
  }
}

TEST(Ledger, EndsARunThatMakesEnergy) {
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    FreeBox box;
    box.scene.initial.clear();
    box.scene.gravity = Vector3d(0, -9.81, 0);
    box.scene.material.law = law;
    box.scene.supports = {held_face()};
    box.scene.reference.integrator = "central_differences";
    box.scene.time.step = 0;
    const double stable = 2 * box.simulation().step();
    for (const double part : {0.9, 1.15}) {
      box.scene.time.step = part * stable;
      box.scene.time.end = 100 * stable;
      Simulation simulation = box.simulation();
      while (!simulation.has_ended()) simulation.advance();
      if (law == MaterialLaw::SmallStrain && part > 1)
        EXPECT_EQ(simulation.status(), Status::EnergyGained);
      else  // at large strain such a body may turn inside out before it has gained so much
        EXPECT_EQ(simulation.status() == Status::Ok, part < 1) << name_of(simulation.status());
    }
  }
}

TEST(SmallStrain, EndsWhereItIsNotSmall) {
  for (const TimeMode mode : {TimeMode::Static, TimeMode::Dynamic}) {
    FreeBox box;
    box.scene.initial.clear();
    box.scene.gravity = Vector3d(0, -1e6, 0);
    box.scene.material.law = MaterialLaw::SmallStrain;
    box.scene.time.mode = mode;
    box.scene.supports = {held_face()};
    Simulation simulation = box.simulation();
    while (!simulation.has_ended()) simulation.advance();
    EXPECT_EQ(simulation.status(), Status::StrainTooLarge);
    EXPECT_NE(simulation.reason().find("neo_hookean"), std::string::npos);
  }
}

FreeBox held_box_in_statics() {
  FreeBox box;
  box.scene.initial.clear();
  box.scene.material.law = MaterialLaw::SmallStrain;
  box.scene.time.mode = TimeMode::Static;
  box.scene.time.load_steps = 10;
  box.scene.supports = {held_face()};
  return box;
}

TEST(SmallStrain, OfStaticsStoresEnergyByTheSquareOfTheLoad) {
  FreeBox box = held_box_in_statics();
  box.scene.gravity = Vector3d(0, -1e-3, 0);
  Simulation simulation = box.simulation();
  const double of_half = after(5, simulation).snapshot().elastic_energy;
  EXPECT_GT(of_half, 0);
  const double whole = after(5, simulation).snapshot().elastic_energy;
  EXPECT_NEAR(whole, 4 * of_half, 1e-12 * whole);
}

TEST(SmallStrain, OfStaticsEndsAtTheLoadThatStrainsTooMuch) {
  FreeBox box = held_box_in_statics();
  const auto pulled = [&](double by) {
    box.scene.gravity = Vector3d(0, -by, 0);
    Simulation simulation = box.simulation();
    while (!simulation.has_ended()) simulation.advance();
    return std::tuple(simulation.status(), simulation.n_done(), simulation.snapshot().strains.at(0).second);
  };
  const auto [status, n, strain] = pulled(1);
  EXPECT_EQ(status, Status::Ok);
  EXPECT_EQ(std::get<1>(pulled(2.2 * meshing::kLargestSmallStrain / strain)), 5);
}

TEST(Obstacles, AreRefusedWhereTheyBeginInsideTheBody) {
  FreeBox box;
  box.scene.reference.integrator = "minimising_euler";
  box.scene.obstacles.resize(1);
  box.scene.obstacles[0].shape = HalfSpace{Vector3d::Zero(), Vector3d::UnitY()};
  EXPECT_NO_THROW(box.simulation());  // touches
  box.scene.obstacles[0].shape = HalfSpace{Vector3d(0, 0.01, 0), Vector3d::UnitY()};
  EXPECT_THROW(box.simulation(), std::runtime_error);
}

}  // namespace
}  // namespace testbed::fem
