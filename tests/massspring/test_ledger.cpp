// The balance of energy of the springs' motions, and how runs end that make energy from nothing.
#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "massspring/simulation.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kG = 9.81;

/// A box of 1 m x 0.5 m x 0.5 m with a corner at the origin.
struct Block {
  TetMesh mesh = box_tets(4, 2, 2, 0.25);
  SpringNetwork network{mesh.X, mesh.F, {}, mesh.T, mesh.n_surface};
  Scene scene;
  Block() {
    scene.material = {1e6, 0.3, 1000, 0};
    scene.network.calibration = "node_averaged";
    scene.time.mode = TimeMode::Dynamic;
    scene.time.end = 0.1;
    scene.time.step = 1e-3;
    scene.time.integrator = "midpoint";
  }
  void hold_face() {
    Support face;
    face.region.shape = HalfSpace{Vector3d(0.05, 0, 0), Vector3d(1, 0, 0)};
    scene.supports = {face};
  }
  /// A plane below, out of which y points.
  Obstacle& put_on_plane(double y = 0) {
    scene.obstacles.emplace_back();
    scene.obstacles.back().shape = HalfSpace{Vector3d(0, y, 0), Vector3d::UnitY()};
    return scene.obstacles.back();
  }
  void throw_at(const Vector3d& velocity) {
    scene.initial.emplace_back();
    scene.initial[0].velocity = velocity;
  }
};

void run(Simulation& simulation) {
  while (!simulation.has_ended()) simulation.advance();
}

/// A column of the ledger (J).
double of(const Simulation& simulation, const std::string& name) {
  for (const auto& [column, value] : simulation.snapshot().ledger)
    if (column == name) return value;
  throw std::runtime_error("no column " + name);
}

double stored(const Simulation& simulation) {
  const Snapshot snapshot = simulation.snapshot();
  double sum = snapshot.kinetic_energy + snapshot.elastic_energy;
  for (const auto& [column, value] : snapshot.ledger)
    if (column.size() > 7 && column.substr(column.size() - 7) == "_energy") sum += value;
  return sum;
}

TEST(Ledger, ReadsPotentialThatBecomesMotionOfAFallingBody) {
  Block box;
  box.scene.gravity = Vector3d(0, -kG, 0);
  Simulation simulation(box.scene, box.network);
  run(simulation);
  const double m = simulation.model().mass.sum(), t = simulation.state().t, fallen = m * kG * kG * t * t / 2;
  EXPECT_NEAR(of(simulation, "work_of_loads"), fallen, 1e-9 * fallen);
  EXPECT_NEAR(simulation.snapshot().kinetic_energy, fallen, 1e-9 * fallen);
  EXPECT_NEAR(of(simulation, "lost_to_scheme"), 0, 1e-9 * fallen);
  EXPECT_EQ(simulation.status(), Status::Ok);
}

TEST(Ledger, ClosesToRoundingWhereTheSchemeConserves) {
  Block box;
  box.scene.gravity = Vector3d(0, -kG, 0);
  box.scene.material.law = MaterialLaw::SmallStrain;
  box.hold_face();
  Simulation simulation(box.scene, box.network);
  double largest = 0, scheme = 0;
  while (!simulation.has_ended()) {
    simulation.advance();
    largest = std::max(largest, stored(simulation));
    scheme = std::max(scheme, std::abs(of(simulation, "lost_to_scheme")));
    // The columns add up.
    const double in = of(simulation, "work_of_loads"), out = of(simulation, "lost_to_scheme");
    ASSERT_NEAR(stored(simulation), in - out, 1e-12 * largest);
  }
  EXPECT_GT(largest, 0);
  EXPECT_LT(scheme, 1e-6 * largest);
}

// Of a rigid body at speed v, m v^2/2 (1 - exp(-2 c t)).
TEST(Ledger, ReadsWhatDampingTakesOfARigidMotionAndOfAnOscillator) {
  Block box;
  box.scene.material.damping = 5;
  box.throw_at({1, 0, 0});
  {
    Simulation simulation(box.scene, box.network);
    run(simulation);
    const double m = simulation.model().mass.sum(), lost = m / 2 * (1 - std::exp(-2 * 5 * 0.1));
    EXPECT_NEAR(of(simulation, "lost_to_damping"), lost, 1e-4 * lost);
    EXPECT_NEAR(of(simulation, "lost_to_scheme"), 0, 1e-4 * lost);
  }
  box.scene.material.law = MaterialLaw::SmallStrain;
  box.hold_face();
  Simulation simulation(box.scene, box.network);
  const double before = stored(simulation);
  run(simulation);
  const double lost = before - stored(simulation);
  EXPECT_GT(lost, 0.3 * before);
  EXPECT_NEAR(of(simulation, "lost_to_damping"), lost, 0.02 * lost);
}

// mu m g times the way of its centre.
TEST(Ledger, ReadsWhatFrictionTakesOfASlidingBlockByEachContact) {
  for (const char* integrator : {"symplectic_euler", "implicit_euler", "minimising_euler"}) {
    Block box;
    box.scene.gravity = Vector3d(0, -kG, 0);
    box.scene.material.law = MaterialLaw::NeoHookean;
    box.put_on_plane().friction = 0.3;
    box.throw_at({1, 0, 0});
    box.scene.time.integrator = integrator;
    box.scene.time.step = std::string(integrator) == "symplectic_euler" ? 2e-4 : 1e-3;
    box.scene.time.end = 0.25;
    Simulation simulation(box.scene, box.network);
    run(simulation);
    const Eigen::VectorXd& mass = simulation.model().mass;
    const double way = (simulation.snapshot().u.row(0) * mass)(0) / mass.sum(),
                 lost = 0.3 * mass.sum() * kG * way;
    EXPECT_GT(way, 0.1) << integrator;
    EXPECT_NEAR(of(simulation, "lost_to_friction"), lost, 0.1 * lost) << integrator;
    EXPECT_EQ(simulation.status(), Status::Ok) << integrator << simulation.report().reason;
  }
}

// Its contact force is as good as infinite there, and what friction could take, too: nothing of it is stored.
TEST(Ledger, StoresNoFrictionOfABodyThatBeginsAHairAboveItsFloor) {
  Block box;
  box.scene.gravity = Vector3d(0, -kG, 0);
  box.scene.material.law = MaterialLaw::NeoHookean;
  box.put_on_plane(-1e-15).friction = 0.5;
  box.scene.time.integrator = "minimising_euler";
  Simulation simulation(box.scene, box.network);
  run(simulation);
  EXPECT_EQ(simulation.state().ledger.gain(), 0);
  EXPECT_EQ(simulation.status(), Status::Ok);
}

// A support that stretches a bar: what it does is what the bar stores, and what rings in it.
TEST(Ledger, ReadsTheWorkOfASupportThatMoves) {
  Block box;
  box.scene.material.law = MaterialLaw::SmallStrain;
  box.hold_face();
  Support end;
  end.region.shape = HalfSpace{Vector3d(0.95, 0, 0), Vector3d(-1, 0, 0)};
  end.displacement = Vector3d(0.01, 0, 0);
  box.scene.supports.push_back(end);
  Simulation simulation(box.scene, box.network);
  run(simulation);
  const double work = of(simulation, "work_of_supports");
  EXPECT_GT(work, 0);
  EXPECT_NEAR(stored(simulation), work, 1e-9 * work);
}

// A plane that moves at V gives momentum p to a body, and with it the energy p V.
TEST(Ledger, ReadsTheWorkOfAnObstacleThatMoves) {
  for (const char* integrator : {"symplectic_euler", "implicit_euler", "minimising_euler"}) {
    Block box;
    box.scene.material.law = MaterialLaw::NeoHookean;
    box.put_on_plane(-0.01).motion = {{0, 0, 0, 0}, {1, 0, 1, 0}};
    box.scene.time.integrator = integrator;
    box.scene.time.step = 2e-4;
    box.scene.time.end = 0.06;
    Simulation simulation(box.scene, box.network);
    run(simulation);
    const double p = momenta(simulation.model(), simulation.state().v).row(1).sum();
    EXPECT_GT(p, 0) << integrator;
    EXPECT_NEAR(of(simulation, "work_of_obstacles"), p, 0.1 * p) << integrator;
  }
}

// The collapse's work is the change of the stored energy while nothing moves.
TEST(Ledger, ReadsTheWorkOfCollapse) {
  for (const char* calibration : {"node_averaged", "van_gelder"}) {
    Block box;
    box.scene.network.calibration = calibration;
    box.scene.material.law = MaterialLaw::NeoHookean;
    box.scene.time.integrator = "minimising_euler";
    box.scene.time.step = box.scene.time.end;
    box.scene.collapse.emplace();
    box.scene.collapse->coefficient = 0.5;
    box.scene.collapse->pivots.emplace_back();
    Simulation simulation(box.scene, box.network);
    simulation.advance();
    State held = simulation.state();
    held.x = simulation.model().network.X;
    const double work = elastic_energy(simulation.model(), held);
    EXPECT_GT(work, 0) << calibration;
    EXPECT_NEAR(of(simulation, "work_of_rest"), work, 1e-9 * work) << calibration;
    EXPECT_GE(of(simulation, "lost_to_scheme"), 0) << calibration;
  }
}

TEST(Ledger, EndsARunThatMakesEnergy) {
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    Block box;
    box.scene.gravity = Vector3d(0, -kG, 0);
    box.scene.material.law = law;
    box.hold_face();
    box.scene.time.integrator = "symplectic_euler";
    box.scene.time.step = 0;
    const double stable = 2 * Simulation(box.scene, box.network).step();
    for (const double part : {0.9, 1.15}) {
      box.scene.time.step = part * stable;
      box.scene.time.end = 100 * stable;
      Simulation simulation(box.scene, box.network);
      run(simulation);
      if (law == MaterialLaw::SmallStrain && part > 1)
        EXPECT_EQ(simulation.status(), Status::EnergyGained);
      else  // at large strain such a body may turn inside out before it has gained so much
        EXPECT_EQ(simulation.status() == Status::Ok, part < 1) << name_of(simulation.status());
    }
  }
}

TEST(Ledger, GoesOnFromAState) {
  Block box;
  box.scene.gravity = Vector3d(0, -kG, 0);
  box.hold_face();
  Simulation whole(box.scene, box.network), parted(box.scene, box.network);
  for (int n = 0; n < 10; ++n) whole.advance();
  parted.set_state(whole.state());
  for (Simulation* simulation : {&whole, &parted}) run(*simulation);
  EXPECT_EQ(whole.snapshot().ledger, parted.snapshot().ledger);
}

// A ball's corners meet the floor one after the other: what a step makes of each blow adds up.
TEST(Blows, MakeNoEnergyByAnyIntegrator) {
  for (const Integrator& integrator : integrators()) {
    if (!integrator.ends_where_it_solves || integrator.name == "explicit_euler") continue;
    Block box;
    box.scene.material = {1e5, 0.3, 1000, 0};
    box.scene.material.law = MaterialLaw::NeoHookean;
    box.put_on_plane(-0.05).shape = HalfSpace{Vector3d(0, -0.05, 0), Vector3d(0.2, 1, 0.1)};
    box.throw_at({0, -2, 0});
    box.scene.time.integrator = integrator.name;
    box.scene.time.step = integrator.is_explicit ? 0 : 2e-3;
    if (integrator.name == "rk4") {  // which is stable at twice the step of others
      box.scene.material.E = 1e7;
      box.scene.time.step = 2 * Simulation(box.scene, box.network).step();
    }
    box.scene.time.end = 0.3;
    Simulation simulation(box.scene, box.network);
    run(simulation);
    EXPECT_GT(simulation.snapshot().kinetic_energy, 0);
    EXPECT_LT(simulation.state().ledger.gain(), 0.02) << integrator.name;
    EXPECT_EQ(simulation.status(), Status::Ok) << integrator.name;
  }
}

TEST(SmallStrain, EndsWhereItIsNotSmall) {
  for (const TimeMode mode : {TimeMode::Static, TimeMode::Dynamic}) {
    Block box;
    box.scene.gravity = Vector3d(0, -1e5 * kG, 0);
    box.scene.material.law = MaterialLaw::SmallStrain;
    box.scene.time.mode = mode;
    box.hold_face();
    Simulation simulation(box.scene, box.network);
    run(simulation);
    EXPECT_EQ(simulation.status(), Status::StrainTooLarge);
    EXPECT_NE(simulation.report().reason.find("neo_hookean"), std::string::npos);
    EXPECT_GT(simulation.snapshot().strains.at(0).second, meshing::kLargestSmallStrain);
  }
}

TEST(Obstacles, AreRefusedWhereTheyBeginInsideTheBody) {
  Block box;
  box.scene.gravity = Vector3d(0, -kG, 0);
  box.scene.time.integrator = "minimising_euler";
  const auto refuses = [&](const auto& shape) {
    box.scene.obstacles.resize(1);
    box.scene.obstacles[0].shape = shape;
    try {
      const Simulation simulation(box.scene, box.network);
    } catch (const std::runtime_error& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(refuses(HalfSpace{Vector3d::Zero(), Vector3d::UnitY()}), "");  // touches
  EXPECT_NE(refuses(HalfSpace{Vector3d(0, 0.01, 0), Vector3d::UnitY()}).find("0.01 m inside"),
            std::string::npos);
  EXPECT_NE(refuses(Ball{Vector3d(0.5, 0.25, 0.25), 2}), "");                      // around the body
  EXPECT_NE(refuses(Ball{Vector3d(1. / 3, 1. / 6, 0.5), 0.1}), "");                // between its nodes
  EXPECT_NE(refuses(meshing::Box{Vector3d(0, 0, 0), Vector3d(1, 0.5, 0.5)}), "");  // its own surface
}

}  // namespace
}  // namespace testbed::massspring
