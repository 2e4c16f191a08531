#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <utility>

#include "massspring/calibrations/calibrate.h"
#include "massspring/time/integrators.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface_io.h"
#include "meshing/surface_energies/barrier.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

Obstacle floor_with(double friction) {
  Obstacle obstacle;
  obstacle.shape = HalfSpace{{0, 0, 0}, {0, 2, 0}};
  obstacle.friction = friction;
  return obstacle;
}

TEST(ContactsOf, TakesThicknessAndFrictionOfSelfContactFromTheSceneWhereItIsOn) {
  const SurfaceMesh ball = make_shape("ball", 42);
  Scene scene;
  scene.self_contact = {false, 0.01, 0.3};
  EXPECT_FALSE(contacts_of(scene, ball).self_thickness);
  scene.self_contact.is_on = true;
  const Contacts contacts = contacts_of(scene, ball);
  EXPECT_EQ(contacts.self_thickness, 0.01);
  EXPECT_EQ(contacts.self_friction, 0.3);
}

// 2 kg that hit the floor at 1 m/s lose 0.3 m/s of their speed along it.
TEST(PushOut, CountsWhatFrictionTakesOfABlow) {
  State before;
  before.x = Vector3d(0, 1e-3, 0);
  before.v = Vector3d(1, -1, 0);
  constexpr double kStep = 0.01;
  Matrix3Xd x = before.x + kStep * before.v, v = before.v;
  std::vector<Eigen::VectorXd> clearance;
  meshing::EnergyFlows flows;
  ASSERT_TRUE(push_out({meshing::RigidBody(floor_with(0.3))}, before, kStep, Eigen::VectorXd::Constant(1, 2),
                       clearance, x, v, flows));
  EXPECT_LT((v.col(0) - Vector3d(0.7, 0, 0)).norm(), 1e-12);
  EXPECT_NEAR(flows.friction, 1 - 0.7 * 0.7, 1e-12);
  EXPECT_EQ(flows.obstacles, 0);
}

// A plate that rises at 1 m/s and slides at 0.5 m/s hits 2 kg at rest, which slip along it at 0.2 m/s then.
TEST(PushOut, PassesTheMomentumOfAMovingPlateOnToANodeAtRest) {
  Obstacle plate = floor_with(0.3);
  plate.motion = {{0, 0, 0, 0}, {1, 0.5, 1, 0}};
  State before;
  before.x = Vector3d(0, 1e-3, 0);
  before.v = Vector3d::Zero();
  constexpr double kStep = 0.01;
  Matrix3Xd x = before.x, v = before.v;
  std::vector<Eigen::VectorXd> clearance;
  meshing::EnergyFlows flows;
  ASSERT_TRUE(push_out({meshing::RigidBody(plate)}, before, kStep, Eigen::VectorXd::Constant(1, 2), clearance,
                       x, v, flows));
  EXPECT_LT((v.col(0) - Vector3d(0.3, 1, 0)).norm(), 1e-12);
  EXPECT_NEAR(flows.obstacles, 2 * (0.3 * 0.5 + 1), 1e-12);
  EXPECT_NEAR(flows.friction, 2 * 0.3 * (0.5 + 0.2) / 2, 1e-12);
}

// A soft cube of 1 m, its underside at y = 0.
struct Cube {
  MassSpringModel model;
  Forces forces;
  Contacts contacts;
  State state;

  Cube(const Vector3d& gravity, const std::vector<Obstacle>& obstacles, double lift, double E = 1e5) {
    const TetMesh mesh = box_tets(2, 2, 2, 0.5);
    SpringNetwork network;
    network.X = mesh.X;
    network.F = mesh.F;
    network.T = mesh.T;
    network.n_surface = static_cast<int>(mesh.X.cols());
    model = calibrate(network, {E, 0.25, 1000, 0}, find_calibration("node_averaged"));
    forces.load = gravity * model.mass.transpose();
    for (const Obstacle& obstacle : obstacles) contacts.bodies.emplace_back(obstacle);
    state = initial_state(model);
    state.x.row(1).array() += lift;
  }

  double energy() const {
    return potential(model, forces, state) + state.v.colwise().squaredNorm().dot(model.mass) / 2;
  }
};

class ContactOf : public testing::TestWithParam<std::string> {
 protected:
  double step() const { return GetParam() == "symplectic_euler" ? 1e-3 : 5e-3; }
};
INSTANTIATE_TEST_SUITE_P(, ContactOf,
                         testing::Values("symplectic_euler", "implicit_euler", "minimising_euler"),
                         [](const auto& info) {
                           return info.param == "symplectic_euler" ? "projected"
                                  : info.param == "implicit_euler" ? "constrained"
                                                                   : "barrier";
                         });

TEST_P(ContactOf, ADroppedCubeComesToRestOnTheFloorGainsNoEnergyAndNeverEndsAStepInside) {
  Cube cube({0, -9.81, 0}, {floor_with(0.3)}, 0.2);
  cube.forces.mass_damping = 5;
  TimeStepper stepper(cube.model, cube.forces, GetParam(), 4, {}, cube.contacts);
  double energy = cube.energy();
  const double scale = 9.81 * cube.model.mass.sum() * 0.2;  // of the fall
  bool has_touched = false;
  while (cube.state.t < 4) {
    ASSERT_EQ(stepper.step(cube.state, step()).status, Status::Ok);
    const double lowest = cube.state.x.row(1).minCoeff();
    EXPECT_GE(lowest, -1e-12) << cube.state.t;
    has_touched |= lowest < 2e-3;
    EXPECT_LE(cube.energy(), energy + 1e-3 * scale) << cube.state.t;
    // The explicit scheme's energy swings while the body does: it is held to that of the fall.
    if (GetParam() != "symplectic_euler") energy = std::min(energy, cube.energy());
  }
  EXPECT_TRUE(has_touched);
  EXPECT_LT(cube.state.v.norm(), 2e-2);
  // 9.81 m/s2 of 1000 kg/m3 on E = 1e5 Pa shorten the column by 5 % at its top.
  EXPECT_NEAR(cube.state.x.row(1).maxCoeff(), 0.95, 0.02);
}

/// A cube that slides as a rigid one does: so stiff that its shear is below a hundredth of the ways, and laid
/// down without a blow, which would take speed along the floor.
struct SlidingCube : Cube {
  static constexpr double g = 9.81, c = 5;  // c: damping, 1/s, which stills the cube's own swings
  const double h;
  std::optional<TimeStepper> stepper;

  SlidingCube(const std::string& integrator, double angle, const Obstacle& floor)
      : Cube(pressing(angle), {floor}, 1e-3, 1e8), h(integrator == "symplectic_euler" ? 2e-4 : 5e-4) {
    const auto begin = [&] { stepper.emplace(model, forces, integrator, 1, IntegratorOptions{}, contacts); };
    forces.mass_damping = 50;
    const double friction = std::exchange(contacts.bodies[0].friction, 0);
    begin();
    run_for(0.5);
    forces.mass_damping = c;
    contacts.bodies[0].friction = friction;
    forces.load.row(0) = g * std::sin(angle) * model.mass.transpose();
    begin();
  }
  static Vector3d pressing(double angle) { return {0, -g * std::cos(angle), 0}; }
  double centre() const { return state.x.row(0).dot(model.mass) / model.mass.sum(); }
  /// The way that its centre goes.
  double run_for(double time) {
    const double from = centre(), end = state.t + time;
    while (state.t < end - h / 2 && !testing::Test::HasFatalFailure()) {
      const Status status = stepper->step(state, h).status;
      [&] { ASSERT_EQ(status, Status::Ok) << state.t; }();
    }
    return centre() - from;
  }
};

TEST_P(ContactOf, OnAnInclineItStopsJustAboveTheAngleOfFrictionAndSpeedsUpJustBelow) {
  constexpr double g = SlidingCube::g, c = SlidingCube::c, kStart = 0.3;
  const double angle = std::atan(0.5);
  for (const double friction : {0.55, 0.45}) {
    SlidingCube cube(GetParam(), angle, floor_with(friction));
    cube.state.v.row(0).setConstant(kStart);
    const double a = g * (std::sin(angle) - friction * std::cos(angle));
    const double first = cube.run_for(0.5), second = cube.run_for(0.5);
    const auto way = [&](double t) {
      return a / c * t + (kStart / c - a / (c * c)) * (1 - std::exp(-c * t));
    };
    if (friction > 0.5) {
      const double stop = std::log(1 - c * kStart / a) / c;  // v = a/c + (start - a/c) e^-ct
      EXPECT_NEAR(first, way(stop), 0.02 * way(stop));
      EXPECT_LT(std::abs(second), 0.01 * way(stop));
    } else {
      EXPECT_NEAR(first, way(0.5), 0.02 * way(0.5));
      EXPECT_NEAR(second, way(1) - way(0.5), 0.02 * (way(1) - way(0.5)));
    }
  }
}

TEST_P(ContactOf, AMovingPlateDragsTheBodyUntilItMovesWithThePlate) {
  constexpr double kFriction = 0.3, kSpeed = 0.3, a = kFriction * SlidingCube::g, c = SlidingCube::c;
  Obstacle plate = floor_with(kFriction);
  plate.motion = {{0, 0, 0, 0}, {10, 10 * kSpeed, 0, 0}};
  SlidingCube cube(GetParam(), 0, plate);
  EXPECT_LT(cube.state.v.row(0).norm(), 1e-4 * kSpeed) << "no friction yet";
  const double until = -std::log(1 - c * kSpeed / a) / c;  // v = a/c (1 - e^-ct)
  const double slip = kSpeed * until - a / c * until + a / (c * c) * (1 - std::exp(-c * until));
  const double way = cube.run_for(0.5);
  EXPECT_NEAR(0.5 * kSpeed - way, slip, 0.02 * slip);
  EXPECT_NEAR(cube.run_for(0.2), 0.2 * kSpeed, 0.01 * slip);
}

TEST_P(ContactOf, AThinPlateIsNotMissedByAFastBody) {
  Obstacle plate;
  plate.shape = Box{{-5, -1.001, -5}, {5, -1, 5}};
  Cube cube({0, 0, 0}, {plate}, 0, 1e10);
  cube.state.v.row(1).setConstant(-300);  // 1.5 m in a step of 5 ms
  TimeStepper stepper(cube.model, cube.forces, GetParam(), 1, {}, cube.contacts);
  stepper.step(cube.state, 5e-3);
  EXPECT_GE(cube.state.x.row(1).minCoeff(), -1 - 1e-9);
}

TEST_P(ContactOf, AMovingObstaclePushesTheBodyAlong) {
  Obstacle piston = floor_with(0);
  piston.motion = {{0, 0, 0, 0}, {1, 0, 1, 0}};
  Cube cube({0, 0, 0}, {piston}, 1e-2);
  cube.forces.mass_damping = 1;
  TimeStepper stepper(cube.model, cube.forces, GetParam(), 1, {}, cube.contacts);
  while (cube.state.t < 1) {
    ASSERT_EQ(stepper.step(cube.state, step()).status, Status::Ok);
    EXPECT_GE(cube.state.x.row(1).minCoeff(), cube.state.t - 1e-9);
  }
  EXPECT_GT(cube.state.x.row(1).minCoeff(), 0.9);
}

/// Two nodes above each other on the floor, a stiff spring between them.
struct Column {
  MassSpringModel model;
  Forces forces;
  Contacts contacts;

  explicit Column(double friction) {
    model.network.X.setZero(3, 2);
    model.network.X(1, 1) = 1;
    model.network.F.resize(3, 0);
    model.mass = Eigen::Vector2d(1, 2);
    model.springs = Springs{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, 2e4), 0};
    forces = no_forces(model);
    forces.load = Vector3d(0, -10, 0) * model.mass.transpose();
    forces.mass_damping = 1;
    contacts.bodies.emplace_back(floor_with(friction));
  }
};

// The support drives the node down a slope of 45 degrees, the floor holds it: it goes along the floor at the
// speed whose part along the support is the support's.
TEST(ActiveSet, ANodeInTouchFollowsItsSupportAlongTheFloor) {
  Column column(0);
  const Vector3d p = Vector3d(1, -1, 0) / std::sqrt(2.0);
  constexpr double h = 0.01, kBegin = 0.1, kSpeed = 0.2;
  Path path{{0, 0, 0, 0}, {kBegin, 0, 0, 0}, {kBegin + 1, kSpeed * p(0), kSpeed * p(1), 0}};
  const auto motion = std::make_shared<const Path>(path);
  column.forces.constraints.push_back({0,
                                       Eigen::Matrix3d::Identity() - p * p.transpose(),
                                       Vector3d::Zero(),
                                       Vector3d::Zero(),
                                       {motion, motion, motion}});
  TimeStepper stepper(column.model, column.forces, "implicit_euler", 1, {1e-13}, column.contacts);
  State state = initial_state(column.model);
  for (int i = 1; i <= 40; ++i) {
    ASSERT_EQ(stepper.step(state, h).status, Status::Ok);
    if (i < 5) continue;  // it comes into touch
    const double way = std::sqrt(2.0) * kSpeed * std::max(0.0, state.t - kBegin);
    EXPECT_LT((state.x.col(0) - Vector3d(way, 0, 0)).norm(), 1e-9) << state.t;
  }
}

TEST(ActiveSet, ANodeThatHasNotSlippedAtAllSticks) {
  constexpr double kFriction = 0.5, kWeight = 30;
  Column column(kFriction);
  TimeStepper stepper(column.model, column.forces, "implicit_euler", 1, {1e-13}, column.contacts);
  State state = initial_state(column.model);
  const auto run = [&](int n_steps) {
    for (int i = 0; i < n_steps; ++i) ASSERT_EQ(stepper.step(state, 0.01).status, Status::Ok);
  };
  run(50);
  column.forces.load(0, 0) = 0.9 * kFriction * kWeight;
  run(50);
  EXPECT_EQ(state.x(0, 0), 0);
  column.forces.load(0, 0) = 1.1 * kFriction * kWeight;
  run(50);
  EXPECT_GT(state.x(0, 0), 0.01);
}

TEST(ActiveSet, ANodeThatIsPulledUpLeavesTheFloor) {
  Column column(0.5);
  TimeStepper stepper(column.model, column.forces, "implicit_euler", 1, {1e-13}, column.contacts);
  State state = initial_state(column.model);
  const auto run = [&](int n_steps) {
    for (int i = 0; i < n_steps; ++i) ASSERT_EQ(stepper.step(state, 0.01).status, Status::Ok);
  };
  run(50);
  EXPECT_NEAR(state.x(1, 0), 0, 1e-9);
  column.forces.load *= -0.5;
  run(50);
  const double a = 5, c = column.forces.mass_damping, t = 0.5;
  const double way = a / c * t - a / (c * c) * (1 - std::exp(-c * t));
  EXPECT_NEAR(state.x(1, 0), way, 0.05 * way);  // a step of a fiftieth of the time comes too late
}

TEST(PushOut, LeavesAloneOnlyNodesThatItWouldNotMove) {
  Obstacle ball, plate;
  ball.shape = Ball{{0.4, 0, 0}, 0.3};
  ball.motion = {{0, 0, 0, 0}, {1, -0.8, 0.3, 0}};
  plate.shape = Box{{-0.5, -0.6, -0.5}, {0.5, -0.599, 0.5}};
  plate.friction = 0.4;
  const std::vector<RigidBody> bodies{RigidBody(ball), RigidBody(plate)};
  constexpr double h = 0.01;
  constexpr int n = 200;
  State state;
  state.x = random_points(n, 1, 1);
  state.v = random_points(n, 3, 2);
  const Eigen::VectorXd mass = Eigen::VectorXd::Ones(n);
  std::vector<Eigen::VectorXd> clearance;
  int n_moved = 0;
  while (state.t < 1) {
    state.v.row(1).array() -= 9.81 * h;
    state.v -= 20 * h * state.x;  // sends them round and past the obstacles again and again
    const Matrix3Xd free_x = state.x + h * state.v;
    Matrix3Xd x = free_x, v = state.v, all_x = x, all_v = v;
    meshing::EnergyFlows flows, all_flows;
    push_out(bodies, state, h, mass, clearance, x, v, flows);
    std::vector<Eigen::VectorXd> unknown;
    push_out(bodies, state, h, mass, unknown, all_x, all_v, all_flows);
    ASSERT_EQ(flows.put_in(), all_flows.put_in()) << state.t;
    ASSERT_EQ(x, all_x) << state.t;
    ASSERT_EQ(v, all_v) << state.t;
    n_moved += static_cast<int>((x - free_x).colwise().any().count());
    state.x = x;
    state.v = v;
    state.t += h;
  }
  EXPECT_GT(n_moved, 500);
}

TEST(RigidBody, GapsAreTheDistancesToDenseSamplesOfTheSurfaces) {
  // A ball's gap is known; a capsule and a box are checked by distances to many points of their surfaces.
  Obstacle box, capsule;
  box.shape = Box{{-1, -0.5, -0.25}, {1, 0.5, 0.25}};
  capsule.shape = Capsule{{-1, 0, 0}, {1, 0, 0}, 0.4};
  constexpr int kSide = 160;
  Matrix3Xd on_box(3, 6 * (kSide + 1) * (kSide + 1)), on_capsule(3, (kSide + 1) * (kSide + 1));
  int n = 0, m = 0;
  for (int i = 0; i <= kSide; ++i)
    for (int j = 0; j <= kSide; ++j) {
      const double a = 2.0 * i / kSide - 1, b = 2.0 * j / kSide - 1;
      for (int k = 0; k < 3; ++k)
        for (const double side : {-1.0, 1.0}) {
          Vector3d p;
          p(k) = side;
          p((k + 1) % 3) = a;
          p((k + 2) % 3) = b;
          on_box.col(n++) = p.cwiseProduct(Vector3d(1, 0.5, 0.25));
        }
      // A line of the capsule's profile, by arc length, turned about the axis.
      const double quarter = 0.2 * M_PI, s = (a + 1) / 2 * (2 + 2 * quarter), phi = M_PI * b;
      const double turn = s < quarter ? (quarter - s) / 0.4 : s > quarter + 2 ? (s - quarter - 2) / 0.4 : 0;
      const double along = s < quarter       ? -1 - 0.4 * std::sin(turn)
                           : s > quarter + 2 ? 1 + 0.4 * std::sin(turn)
                                             : s - quarter - 1;
      const double radius = 0.4 * std::cos(turn);
      on_capsule.col(m++) << along, radius * std::cos(phi), radius * std::sin(phi);
    }
  Random random(3);
  const RigidBody bodies[] = {RigidBody(box), RigidBody(capsule)};
  const Matrix3Xd* samples[] = {&on_box, &on_capsule};
  for (int trial = 0; trial < 200; ++trial) {
    Vector3d x;
    for (double& c : x) c = 3 * random.uniform() - 1.5;
    for (int b = 0; b < 2; ++b) {
      const double nearest = (samples[b]->colwise() - x).colwise().norm().minCoeff();
      const RigidBody::Gap gap = bodies[b].gap(x, 0);
      EXPECT_NEAR(std::abs(gap.distance), nearest, 2e-2);
      EXPECT_NEAR(bodies[b].gap(x + 1e-6 * gap.normal, 0).distance, gap.distance + 1e-6, 1e-9);
    }
  }
}

TEST(RigidBody, AMeshIsTheSolidThatItBounds) {
  const SurfaceMesh ball = make_shape("ball", 642);
  const std::string file = testing::TempDir() + "contact_ball.off";
  write_surface(file, ball);
  Obstacle mesh;
  mesh.shape = ClosedMesh{file};
  mesh.motion = {{0, 1, 2, 3}};
  const RigidBody body(mesh);
  const double radius = ball.X.col(0).norm(), faceting = 0.01 * radius;
  Random random(5);
  for (int trial = 0; trial < 100; ++trial) {
    Vector3d x;
    for (double& c : x) c = radius * (3 * random.uniform() - 1.5);
    const RigidBody::Gap gap = body.gap(x + Vector3d(1, 2, 3), 0);
    EXPECT_NEAR(gap.distance, x.norm() - radius, faceting);
    EXPECT_GT(gap.normal.dot(x), 0.9 * x.norm());
  }
}

TEST(Barrier, ForceIsMinusEnergyGradientAndHessianItsDerivativeOnAPlane) {
  Cube cube({0, 0, 0}, {floor_with(0.4)}, 0);
  const double range = 1e-3 * std::sqrt(3.0), step = 1e-9;
  for (const double slid : {1e-6, 4e-6}) {  // friction is smoothed up to 1.7e-6 m
    Matrix3Xd x = cube.state.x;
    const Eigen::VectorXd weights = Eigen::VectorXd::LinSpaced(x.cols(), 0.5, 1.5);
    Barrier barrier(weights, range, 5e4, cube.contacts.bodies);
    x.row(1).array() += 0.5 * range;
    barrier.begin_step(0, 1e-2, x);
    x.row(0).array() += slid;
    x.row(1).array() += 0.1 * range;
    x.row(2).array() -= slid / 2;
    const auto forces = [&](const Matrix3Xd& at) {
      Matrix3Xd f = Matrix3Xd::Zero(3, at.cols());
      barrier.add_forces(at, f);
      return f;
    };
    const Matrix3Xd f = forces(x);
    ASSERT_GT(f.row(1).norm(), 1);
    ASSERT_GT(f.row(0).norm(), 1);
    barrier.follow(x, x);  // the friction of x itself
    SurfaceHessian H;
    barrier.add_hessian(x, H, Curvature::Projected);
    const std::vector<Eigen::Matrix3d>& K = H.diagonal;
    for (int i = 0; i < x.cols(); ++i) {
      for (int c = 0; c < 3; ++c) {
        Matrix3Xd up = x, down = x;
        up(c, i) += step;
        down(c, i) -= step;
        EXPECT_NEAR(f(c, i), -(barrier.energy(up) - barrier.energy(down)) / (2 * step), 1e-4 * f.norm());
        const Vector3d column = (forces(down) - forces(up)).col(i) / (2 * step);
        EXPECT_LE((K[i].col(c) - column).norm(), 1e-4 * K[i].norm());
      }
    }
    x(1, 0) = -range;
    EXPECT_TRUE(std::isinf(barrier.energy(x)));
  }
}

// Friction is smoothed over a millionth of the body's size, and a node that comes too near takes an iteration
// for every halving of its gap.
TEST(Barrier, StepsThatLandSlideAndStopTakeFewNewtonIterations) {
  Cube cube({0, -9.81, 0}, {floor_with(0.4)}, 0.05);
  cube.forces.mass_damping = 1;
  cube.state.v.row(0).setConstant(1);
  const double from = cube.state.x.row(0).mean();
  TimeStepper stepper(cube.model, cube.forces, "minimising_euler", 1, {}, cube.contacts);
  while (cube.state.t < 1) {
    const StepReport report = stepper.step(cube.state, 1. / 60);
    ASSERT_EQ(report.status, Status::Ok);
    EXPECT_LE(report.newton_iterations, 12) << cube.state.t;
  }
  EXPECT_GT(cube.state.x.row(0).mean() - from, 0.05);
  EXPECT_LT(cube.state.x.row(1).minCoeff(), 2e-3);
}

}  // namespace
}  // namespace testbed::massspring
