// A scene's body in motion: how it begins, and what its supports hold.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "massspring/simulation.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/box_tets.h"
#include "tests/meshing/rolling.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

const Vector3d kVelocity(3, -1, 2), kSpin(0.5, 2, -1);

/// A box of 1 m x 0.5 m x 0.5 m that nothing holds, whose inner nodes lie anywhere.
struct FreeBox {
  TetMesh mesh = box_tets(4, 2, 2, 0.25, 0.1);
  SpringNetwork network{mesh.X, mesh.F, {}, mesh.T, mesh.n_surface};
  Scene scene;
  FreeBox() {
    scene.material = {1e6, 0.3, 1000, 0};
    scene.network.calibration = "node_averaged";
    scene.time.mode = TimeMode::Dynamic;
    scene.time.end = 0.1;
    scene.time.step = 1e-3;
    scene.initial.emplace_back();
  }
};

Vector3d angular_momentum(const Simulation& simulation) {
  const State& state = simulation.state();
  const Matrix3Xd p = momenta(simulation.model(), state.v);
  Vector3d sum = Vector3d::Zero();
  for (Eigen::Index i = 0; i < p.cols(); ++i) sum += state.x.col(i).cross(p.col(i));
  return sum;
}

TEST(InitialMotion, CarriesAFreeBodyAtItsVelocityByEveryIntegrator) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
    for (const Integrator& integrator : integrators()) {
      box.scene.material.law = law;
      box.scene.time.integrator = integrator.name;
      Simulation simulation(box.scene, box.network);
      while (!simulation.has_ended()) simulation.advance();
      const Matrix3Xd expected = (kVelocity * simulation.state().t).replicate(1, box.network.X.cols());
      EXPECT_NEAR(simulation.state().t, box.scene.time.end, 1e-12);
      EXPECT_LT((simulation.snapshot().u - expected).norm(), 1e-9 * expected.norm()) << integrator.name;
    }
}

TEST(InitialMotion, SpinsAStiffBodyThatKeepsItsAngularMomentum) {
  FreeBox box;
  box.scene.initial[0].spin = kSpin;
  box.scene.material.E = 1e8;
  box.scene.time.end = 0.02;
  struct Case {
    const char* integrator;
    double step, tolerance;  // midpoint's stages stop where a step is below 1e-9 of the body
  };
  for (const auto& [integrator, step, tolerance] :
       {Case{"symplectic_euler", 2e-5, 1e-11}, Case{"midpoint", 1e-3, 1e-5}}) {
    box.scene.time.integrator = integrator;
    box.scene.time.step = step;
    Simulation simulation(box.scene, box.network);
    const Vector3d before = angular_momentum(simulation);
    const Matrix3Xd X = simulation.state().x;
    const Vector3d centre = X * simulation.model().mass / simulation.model().mass.sum();
    while (!simulation.has_ended()) simulation.advance();
    const State& state = simulation.state();
    EXPECT_LT((angular_momentum(simulation) - before).norm(), tolerance * before.norm()) << integrator;
    // In a fiftieth of a second the axis of a body with unequal moments stays where it was, nearly.
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(kSpin.norm() * state.t, kSpin.normalized()).matrix();
    const Matrix3Xd turned = (turn * (X.colwise() - centre)).colwise() + centre;
    EXPECT_LT((state.x - turned).norm(), 0.02 * (turned - X).norm()) << integrator;
  }
}

TEST(Change, OfAnObstacleThatWasFarStopsABodyThatFallsOnIt) {
  FreeBox box;
  box.scene.initial[0].velocity = {0, -5, 0};
  box.scene.time.integrator = "symplectic_euler";
  box.scene.time.step = 1e-3;
  box.scene.obstacles.emplace_back().shape = HalfSpace{{0, -9, 0}, {0, 1, 0}};
  Simulation simulation(box.scene, box.network);
  simulation.advance();
  const double floor = box.network.X.row(1).minCoeff() - 0.02;
  box.scene.obstacles[0].shape = HalfSpace{{0, floor, 0}, {0, 1, 0}};
  simulation.change(box.scene);
  for (int n = 0; n < 20; ++n) ASSERT_EQ(simulation.advance(), Status::Ok);
  EXPECT_NEAR(simulation.state().x.row(1).minCoeff(), floor, 1e-9);
}

TEST(InitialMotion, IsOverruledBySupports) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  Support face;
  face.region.shape = HalfSpace{Vector3d(0.05, 0, 0), Vector3d(1, 0, 0)};
  face.fixed = {{true, false, true}};
  box.scene.supports = {face};
  for (const char* integrator : {"symplectic_euler", "rk4", "midpoint"}) {
    box.scene.time.integrator = integrator;
    box.scene.time.step = 1e-5;
    Simulation simulation(box.scene, box.network);
    const int constrained = simulation.forces().constraints.at(0).node;
    EXPECT_EQ(simulation.state().v.col(constrained), Vector3d(0, kVelocity.y(), 0));
    EXPECT_EQ(simulation.state().v.rightCols(1), kVelocity);
    for (int n = 0; n < 10; ++n) simulation.advance();
    for (const Constraint& c : simulation.forces().constraints) {
      EXPECT_EQ(simulation.state().x(0, c.node), box.network.X(0, c.node)) << integrator;
      EXPECT_EQ(simulation.state().v(0, c.node), 0) << integrator;
    }
    EXPECT_GT(simulation.snapshot().u.rightCols(1).norm(), 0) << integrator;
  }
}

TEST(Motion, IsDampedByMaterialAndRatioTogether) {
  FreeBox box;
  box.scene.material.damping_ratio = 0.1;
  const double of_ratio = Simulation(box.scene, box.network).forces().mass_damping;
  EXPECT_GT(of_ratio, 0);
  box.scene.material.damping = 3;
  EXPECT_DOUBLE_EQ(Simulation(box.scene, box.network).forces().mass_damping, of_ratio + 3);
}

TEST(Motion, KeepsTheVolumeAtHandWhileRestLengthsCollapse) {
  FreeBox box;
  box.scene.material.law = MaterialLaw::NeoHookean;
  box.scene.volume.emplace().coefficient = 1e4;
  box.scene.collapse.emplace().coefficient = 0.9;
  box.scene.collapse->pivots.push_back({Vector3d(0.5, 0.25, 0.25), {}, 0, {}});
  Simulation simulation(box.scene, box.network);
  const double at_rest = simulation.state().target_volume;
  for (int n = 0; n < 50; ++n) simulation.advance();
  const double at_hand = meshing::volume(simulation.state().x, box.mesh.F);
  simulation.advance();
  EXPECT_EQ(simulation.state().target_volume, at_hand);
  EXPECT_LT(at_hand, 0.999 * at_rest);
}

TEST(Motion, HasTheTargetVolumeOfTheEndOfEachStep) {
  FreeBox box;
  box.scene.material.law = MaterialLaw::NeoHookean;
  box.scene.volume.emplace().coefficient = 1e4;
  box.scene.volume->target = {{0, 1}, {1, 3}};
  for (const char* integrator : {"symplectic_euler", "minimising_euler"}) {
    box.scene.time.integrator = integrator;
    box.scene.time.step = 1e-4;
    Simulation simulation(box.scene, box.network);
    const double at_rest = meshing::volume(box.network.X, box.mesh.F);
    for (int n = 1; n <= 3; ++n) {
      ASSERT_EQ(simulation.advance(), Status::Ok);
      EXPECT_NEAR(simulation.state().target_volume / at_rest, 1 + 2e-4 * n, 1e-12) << integrator;
    }
  }
}

// Where a support moves them, nodes have their masses to themselves.
TEST(Motion, LumpsTheMassesOfNodesThatMoveAlongAnyAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    FreeBox box;
    Support face;
    face.region.shape = HalfSpace{Vector3d(0.05, 0, 0), Vector3d(1, 0, 0)};
    face.fixed = {{axis == 0, axis == 1, axis == 2}};
    const Vector3d end = 0.1 * Vector3d::Unit(axis);
    face.motion = {{0, 0, 0, 0}, {1, end.x(), end.y(), end.z()}};
    box.scene.supports = {face};
    const Simulation simulation(box.scene, box.network);
    ASSERT_TRUE(simulation.model().consistent_mass);
    const auto& [E, r] = *simulation.model().consistent_mass;
    for (Eigen::Index e = 0; e < E.cols(); ++e) {
      const bool is_driven = box.network.X(0, E(0, e)) < 0.05 || box.network.X(0, E(1, e)) < 0.05;
      EXPECT_EQ(r(e) == 0, is_driven) << axis;
    }
  }
}

TEST(Motion, EndsWhereThreeStepsInARowDoNotConverge) {
  FreeBox box;
  box.scene.initial[0].spin = kSpin;
  box.scene.time.integrator = "midpoint";
  box.scene.time.tolerance = 1e-25;  // beyond what rounding leaves
  Simulation simulation(box.scene, box.network);
  for (int n = 1; n <= 3; ++n) {
    EXPECT_FALSE(simulation.has_ended()) << n;
    EXPECT_EQ(simulation.advance(), Status::NotConverged) << n;
  }
  EXPECT_TRUE(simulation.has_ended());
  EXPECT_NE(simulation.report().reason.find("3 steps in a row have not converged"), std::string::npos);
  simulation.set_state(simulation.state());
  EXPECT_FALSE(simulation.has_ended()) << "it may be tried anew";
}

TEST(SimulationReport, KeepsItsCountsInWhatIsSaved) {
  SimulationReport report, again;
  report.status = Status::NotConverged;
  int n = 0;
  const auto counts = {&SimulationReport::n_at_rest, &SimulationReport::n_halved,
                       &SimulationReport::n_unsolved, &SimulationReport::newton_iterations,
                       &SimulationReport::linear_iterations};
  for (int SimulationReport::*count : counts) report.*count = ++n;
  Archive to;
  to(report);
  const auto from = std::make_unique<Archive>(to.bytes());
  (*from)(again);
  EXPECT_EQ(again.status, Status::NotConverged);
  for (int SimulationReport::*count : counts) EXPECT_EQ(again.*count, report.*count);
}

TEST(Motion, GoesOnWhereAStepBetweenThoseThatDoNotConvergeDoes) {
  FreeBox box;
  box.scene.initial[0].spin = kSpin;
  box.scene.time.integrator = "midpoint";
  Simulation exact(box.scene, box.network);
  box.scene.time.tolerance = 1e-25;  // beyond what rounding leaves
  Simulation never(box.scene, box.network);
  never.advance();
  never.advance();
  exact.restore(never.saved());
  exact.advance();
  never.restore(exact.saved());
  EXPECT_EQ(never.advance(), Status::NotConverged);
  EXPECT_FALSE(never.has_ended());
}

TEST(Supports, HoldAlongAnyDirectionAsTheyDoAlongAxes) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(M_PI / 4, Vector3d(1, 2, -1).normalized()).matrix();
  FreeBox box;
  const auto last_of = [](const Scene& scene, const SpringNetwork& network) {
    Simulation simulation(scene, network);
    while (!simulation.has_ended()) simulation.advance();
    EXPECT_EQ(simulation.report().status, Status::Ok);
    return simulation.snapshot().u;
  };
  SpringNetwork turned = box.network;
  turned.X = turn * box.network.X;
  box.scene.time.end = 0.02;
  const auto identity = Eigen::Matrix3d::Identity();
  for (const char* integrator : {"static", "symplectic_euler", "implicit_euler", "midpoint"})
    for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
      for (const bool is_axis : {false, true}) {
        const bool is_static = integrator == std::string("static");
        box.scene.time.mode = is_static ? TimeMode::Static : TimeMode::Dynamic;
        if (!is_static) box.scene.time.integrator = integrator;
        box.scene.material.law = law;
        const Vector3d constrained = is_axis ? Vector3d(0, 1, 0) : Vector3d(0, 0, 1);
        Scene by_components = rolling(box.scene, identity, constrained, is_axis);
        Support& roller = by_components.supports[1];
        roller.normal.reset();
        roller.along.reset();
        roller.fixed = {{is_axis, false, true}};
        const Matrix3Xd expected = turn * last_of(by_components, box.network);
        const Matrix3Xd found = last_of(rolling(box.scene, turn, constrained, is_axis), turned);
        constexpr double kSolved = 1e-4;  // linearised steps solve to 1e-6 each
        EXPECT_LT((found - expected).norm(), kSolved * expected.norm()) << integrator << is_axis;
      }
}

TEST(Supports, LetABodySlideDownAnInclineAtTheAccelerationOfAPoint) {
  FreeBox box;
  const Vector3d normal = Vector3d(1, 0, 2).normalized(), gravity(0, 0, -9.81);
  const Vector3d downhill = gravity - gravity.dot(normal) * normal;
  box.scene.initial.clear();
  box.scene.gravity = gravity;
  box.scene.time.integrator = "midpoint";
  Support base;
  base.region.shape = HalfSpace{Vector3d(0, 0, 0.05), Vector3d(0, 0, 1)};
  base.normal = normal;
  box.scene.supports = {base};
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    box.scene.material.law = law;
    Simulation simulation(box.scene, box.network);
    while (!simulation.has_ended()) simulation.advance();
    const Eigen::VectorXd& mass = simulation.model().mass;
    const Vector3d way = simulation.snapshot().u * mass / mass.sum();
    const double t = simulation.snapshot().time;
    EXPECT_NEAR(way.dot(downhill), downhill.squaredNorm() * t * t / 2, 1e-7);
    EXPECT_NEAR(way.dot(normal.cross(downhill)), 0, 1e-7);
  }
}

TEST(Supports, LetGoAtTheirEndByEveryIntegrator) {
  constexpr double kEnd = 0.04, kGravity = 9.81;
  FreeBox box;
  box.scene.initial.clear();
  box.scene.gravity = Vector3d(0, 0, -kGravity);
  Support all;  // surface nodes; what moves inside before the end is small and has no weight on the whole
  all.end = kEnd;
  box.scene.supports = {all};
  for (const Integrator& integrator : integrators()) {
    if (integrator.name == "explicit_euler")
      continue;  // makes energy of what moves inside, which ends the run
    box.scene.time.integrator = integrator.name;
    box.scene.material.law = MaterialLaw::NeoHookean;
    Simulation simulation(box.scene, box.network);
    const Eigen::VectorXd& mass = simulation.model().mass;
    const auto way_of = [&] { return Vector3d(simulation.snapshot().u * mass / mass.sum()); };
    Vector3d at_end = Vector3d::Zero();
    double speed = 0;
    while (!simulation.has_ended()) {
      simulation.advance();
      const double t = simulation.state().t;
      if (t < kEnd + 1e-9) {
        at_end = way_of();
        speed = momenta(simulation.model(), simulation.state().v).row(2).sum() / mass.sum();
        for (const Constraint& c : simulation.forces().constraints)
          ASSERT_EQ(simulation.state().x.col(c.node), box.network.X.col(c.node)) << integrator.name;
      }
    }
    const double fall = box.scene.time.end - kEnd;
    EXPECT_TRUE(simulation.forces().constraints.empty());
    // Schemes of order one are off by half a step of gravity.
    const double expected = at_end.z() + speed * fall - kGravity * fall * fall / 2;
    EXPECT_NEAR(way_of().z(), expected, 0.51 * kGravity * box.scene.time.step * fall) << integrator.name;
  }
}

TEST(Supports, RefuseToMoveANodeThatAnotherHoldsAlongOtherDirections) {
  FreeBox box;
  Support clamp, slide;
  slide.normal = Vector3d(1, 1, 0);
  slide.displacement = Vector3d(0.01, 0, 0);
  box.scene.supports = {clamp, slide};
  try {
    const Simulation simulation(box.scene, box.network);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("two supports hold the node at ("), std::string::npos);
  }
  box.scene.supports[1].displacement.setZero();
  EXPECT_EQ(Simulation(box.scene, box.network).forces().constraints.at(0).S, Eigen::Matrix3d::Zero());
}

/// Bars of two cubes, one behind the other along x with a gap (m) in between; none: one bar of four.
SpringNetwork bars(std::optional<double> gap) {
  const TetMesh whole = box_tets(4, 1, 1, 0.25), half = box_tets(2, 1, 1, 0.25);
  if (!gap) return {whole.X, whole.F, {}, whole.T, whole.n_surface};
  const auto n = static_cast<int>(half.X.cols());
  SpringNetwork both{Matrix3Xd(3, 2 * n),
                     Eigen::Matrix3Xi(3, 2 * half.F.cols()),
                     {},
                     Eigen::Matrix4Xi(4, 2 * half.T.cols()),
                     2 * n};
  both.X << half.X, half.X.colwise() + Vector3d(0.5 + *gap, 0, 0);
  both.F << half.F, (half.F.array() + n).matrix();
  both.T << half.T, (half.T.array() + n).matrix();
  return both;
}

/// Rolling on x = 0, y = 0 and z = 0, and pulled along x at its end.
Scene pulled(double length) {
  constexpr double kNear = 1e-3;  // m
  Scene scene;
  scene.material = {1e6, 0.3, 1000, 0};
  scene.material.law = MaterialLaw::NeoHookean;
  for (int c = 0; c < 3; ++c) {
    Support roller;
    roller.region.shape = HalfSpace{Vector3d::Constant(kNear), Vector3d::Unit(c)};
    roller.fixed = {c == 0, c == 1, c == 2};
    scene.supports.push_back(roller);
  }
  Load pull;
  pull.region.shape = HalfSpace{Vector3d(length - kNear, 0, 0), Vector3d(-1, 0, 0)};
  pull.traction = {1e5, 0, 0};
  scene.loads = {pull};
  scene.time.load_steps = 2;
  return scene;
}

Matrix3Xd pulled_nodes(const Scene& scene, const SpringNetwork& network) {
  Simulation simulation(scene, network);
  while (!simulation.has_ended()) simulation.advance();
  EXPECT_EQ(simulation.report().status, Status::Ok) << simulation.report().reason;
  return simulation.state().x;
}

// Uniform stress passes a seam: its parts stretch as one bar does, and what is left of the gap carries the pull.
TEST(Seams, CloseAGapAndPassStressOn) {
  constexpr double kGap = 0.1, kStitch = 1e9, kPull = 1e5 * 0.25 * 0.25;
  Scene sewn = pulled(1 + kGap);
  sewn.seams = {{{Box{{0.5, -1, -1}, {0.5, 1, 1}}}, {Box{{0.6, -1, -1}, {0.6, 1, 1}}}, kStitch}};
  const SpringNetwork parts = bars(kGap);
  const Matrix3Xd x = pulled_nodes(sewn, parts);
  const double end = pulled_nodes(pulled(1), bars({})).row(0).maxCoeff();
  ASSERT_GT(end, 1.05);
  EXPECT_NEAR(x.row(0).maxCoeff(), end, kPull / kStitch);
  const Eigen::Index n = x.cols() / 2;
  const auto pull = [&](Eigen::Index a) {
    Eigen::Index b;
    (parts.X.rightCols(n).colwise() - parts.X.col(a)).colwise().norm().minCoeff(&b);
    return kStitch * (x(0, n + b) - x(0, a));
  };
  double force = 0;
  for (Eigen::Index a = 0; a < n; ++a)
    if (parts.X(0, a) == 0.5) force += pull(a);
  EXPECT_NEAR(force, kPull, 1e-3 * kPull);
}

TEST(Seams, RefuseANodeTiedToItselfAndRegionsWithoutNodes) {
  const SpringNetwork parts = bars(0.1);
  const auto error_of = [&](double from, double to) -> std::string {
    Scene scene = pulled(1.1);
    scene.seams = {{{Box{{from, -1, -1}, {from, 1, 1}}}, {Box{{to, -1, -1}, {to, 1, 1}}}, 1}};
    try {
      Simulation(scene, parts).has_ended();
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(error_of(0.5, 0.6), "");
  EXPECT_EQ(error_of(0.5, 0.5),
            "seams.0: from and to both hold the node at (0.5   0   0) m, expected no node in common");
  EXPECT_EQ(error_of(0.5, 7),
            "seams.0.to: no node of the surface lies there; the body reaches from 0 0 0 to  1.1 0.25 0.25");
  EXPECT_EQ(error_of(7, 0.5).substr(0, 12), "seams.0.from");
}

}  // namespace
}  // namespace testbed::massspring
