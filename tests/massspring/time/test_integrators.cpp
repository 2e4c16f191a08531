#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "massspring/time/integrators.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kRounding = 1e-12;
constexpr double kNewtonTolerance = 1e-8;  // nonlinear stages stop where a step is below 1e-9 of the body

State advance(const MassSpringModel& model, const Forces& forces, const std::string& integrator, State state,
              double h, int n_steps) {
  constexpr double kTight = 1e-13;
  TimeStepper stepper(model, forces, integrator, 1, {kTight});
  for (int i = 0; i < n_steps; ++i) EXPECT_EQ(stepper.step(state, h).status, Status::Ok);
  return state;
}

double energy_of(const MassSpringModel& model, const State& state) {
  return elastic_energy(model, state) + state.v.colwise().squaredNorm().dot(model.mass) / 2;
}

/// The small model, squeezed, turning and damped by its springs' ends alone.
State lively(const MassSpringModel& model) {
  State state = initial_state(model);
  state.x *= 1.1;
  state.v = random_points(5, 1, 11);
  return state;
}

/// One spring along x, one end fixed: an oscillator of frequency sqrt(k/m) about its rest.
struct Oscillator {
  Oscillator() {
    model.network.X.setZero(3, 2);
    model.network.X(0, 1) = 1;
    model.network.F.resize(3, 0);
    model.mass = Eigen::Vector2d(1, 2);
    model.springs = Springs{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, 2 * omega * omega), 0};
    forces = no_forces(model);
    forces.constraints.push_back({0, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
    start = initial_state(model);
    start.x(0, 1) += 0.1;
  }
  double omega = 3, h = 0.2;
  MassSpringModel model;
  Forces forces;
  State start;
};

// Schemes that minimise take the whole of a linear step only if objective and gradient belong together: much
// damping makes it halve the step otherwise.
TEST(Integrators, DampedOscillatorFollowsEachSchemesRecurrence) {
  for (const auto& [of_spring, of_mass] :
       {std::pair(0., 0.), std::pair(1.2, 0.), std::pair(0., 0.7), std::pair(60., 0.), std::pair(0., 40.)}) {
    Oscillator o;
    o.model.springs->damping = of_spring;  // N s/m
    o.forces.mass_damping = of_mass;       // 1/s
    const double z = o.omega * o.h, d = o.h * (of_spring / o.model.mass(1) + of_mass);
    Eigen::Matrix2d A, I = Eigen::Matrix2d::Identity();  // d/dt (u, v/omega) scaled by h
    A << 0, z, -z, -d;
    const double g = 2 - std::sqrt(2.), a = g / 2, old = 1 / (g * (2 - g));
    const Eigen::Matrix2d stage = (I - a * A).inverse();
    Eigen::Matrix2d symplectic;
    symplectic << 1 - z * z, z * (1 - d), -z, 1 - d;
    const std::vector<std::pair<std::string, Eigen::Matrix2d>> propagators{
        {"explicit_euler", I + A},
        {"symplectic_euler", symplectic},
        {"rk4", I + A + A * A / 2 + A * A * A / 6 + A * A * A * A / 24},
        {"implicit_euler", (I - A).inverse()},
        {"minimising_euler", (I - A).inverse()},
        {"midpoint", (I - A / 2).inverse() * (I + A / 2)},
        {"tr_bdf2", stage * (old * stage * (I + a * A) + (1 - old) * I)}};
    for (const auto& [integrator, P] : propagators) {
      if (find_integrator(integrator).is_explicit && d > 1) continue;  // unstable: the spring would turn over
      constexpr int kSteps = 5;
      const State end = advance(o.model, o.forces, integrator, o.start, o.h, kSteps);
      Eigen::Vector2d u(0.1, 0);
      for (int i = 0; i < kSteps; ++i) u = P * u;
      EXPECT_NEAR(end.x(0, 1) - 1, u(0), kNewtonTolerance)
          << integrator << ' ' << of_spring << ' ' << of_mass;
      EXPECT_NEAR(end.v(0, 1), u(1) * o.omega, kNewtonTolerance * 10) << integrator;
    }
  }
}

TEST(Integrators, Bdf2BeginsAnewByImplicitEulerWhereTheStepHasAnotherLength) {
  Oscillator o;
  const auto matrix = [&](double h) {
    Eigen::Matrix2d A;  // of (u, v)
    A << 0, h, -o.omega * o.omega * h, 0;
    return A;
  };
  const Eigen::Matrix2d I = Eigen::Matrix2d::Identity();
  TimeStepper stepper(o.model, o.forces, "bdf2", 1);
  State state = o.start;
  Eigen::Vector2d u(0.1, 0), before = u;
  double h_before = 0;
  for (const double h : {0.2, 0.2, 0.2, 0.1, 0.1, 0.15}) {
    ASSERT_EQ(stepper.step(state, h).status, Status::Ok);
    const Eigen::Vector2d next = h == h_before
                                     ? ((I - 2. / 3 * matrix(h)).inverse() * (4 * u - before) / 3).eval()
                                     : ((I - matrix(h)).inverse() * u).eval();
    before = u;
    u = next;
    h_before = h;
    EXPECT_NEAR(state.x(0, 1) - 1, u(0), kNewtonTolerance) << state.t;
    EXPECT_NEAR(state.v(0, 1), u(1), kNewtonTolerance * 10) << state.t;
  }
}

// One node is free, along one direction: conjugate gradients end after one iteration, whatever Newton asks.
TEST(Integrators, AStepCountsTheIterationsOfAllItsStages) {
  const Oscillator o;
  for (const auto& [integrator, n_stages] :
       {std::pair("minimising_euler", 1), std::pair("midpoint", 1), std::pair("tr_bdf2", 2)}) {
    TimeStepper stepper(o.model, o.forces, integrator, 1);
    State state = o.start;
    const StepReport report = stepper.step(state, o.h);
    EXPECT_GE(report.newton_iterations, n_stages);
    EXPECT_EQ(report.linear_iterations, report.newton_iterations) << integrator;
  }
}

// A free body turns by a radian within a step, so that Newton's steps go round circles.
TEST(Integrators, TheWayOfAFastTurnIsThatOfItsSpeeds) {
  const MassSpringModel model = small_model(1e4);
  const double h = 0.1;
  State start = initial_state(model);
  for (int i = 0; i < 5; ++i) start.v.col(i) = Eigen::Vector3d(3, -5, 8).cross(start.x.col(i));
  for (const auto& [integrator, new_share] :
       {std::pair("minimising_euler", 1.), std::pair("midpoint", 0.5)}) {
    const State end = advance(model, no_forces(model), integrator, start, h, 1);
    const Matrix3Xd way = h * (new_share * end.v + (1 - new_share) * start.v);
    EXPECT_LT((end.x - start.x - way).norm(), kRounding) << integrator;
  }
}

TEST(Integrators, BackwardEulerFallsByItsClosedForm) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  const Eigen::Vector3d gravity(0, 0, -10);
  forces.load = gravity * model.mass.transpose();
  constexpr int n = 7;
  constexpr double h = 0.01;
  for (const char* integrator : {"implicit_euler", "minimising_euler"}) {
    const State end = advance(model, forces, integrator, initial_state(model), h, n);
    const Eigen::Vector3d fallen = gravity * h * h * n * (n + 1) / 2;
    EXPECT_LT((end.x.colwise() - fallen - model.network.X).norm(), kNewtonTolerance);
  }
}

TEST(Integrators, ConvergeWithTheirOrder) {
  MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  forces.mass_damping = 0.3;
  forces.load = random_points(5, 3, 2);
  add_volume_penalty(20, model, forces);
  constexpr double kEnd = 0.32;
  constexpr double kSlopeTolerance = 0.15;  // steps are finite
  const State start = lively(model);
  const State exact = advance(model, forces, "rk4", start, kEnd / 4096, 4096);
  for (const Integrator& row : integrators()) {
    const int n = row.order == 1 ? 512 : 64;
    const auto error = [&](int n_steps) {
      return (advance(model, forces, row.name, start, kEnd / n_steps, n_steps).x - exact.x).norm();
    };
    const double coarse = error(n), fine = error(2 * n);
    EXPECT_NEAR(std::log2(coarse / fine), row.order, kSlopeTolerance) << row.name;
  }
}

TEST(Integrators, AnUnknownNameIsRefusedWithTheNearestKnownOne) {
  try {
    find_integrator("tr_bdf");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()).substr(0, 77),
              "time.integrator = 'tr_bdf': no such integrator, did you mean tr_bdf2? (known:");
  }
}

TEST(Integrators, LinearisedAndMinimisingEulerAgreeForSmallSteps) {
  MassSpringModel model = small_model();
  model.springs->damping = 0.5;
  const Forces forces = no_forces(model);
  const State start = lively(model);
  double before = 0;
  for (double h : {1e-2, 5e-3}) {
    const double apart = (advance(model, forces, "implicit_euler", start, h, 1).x -
                          advance(model, forces, "minimising_euler", start, h, 1).x)
                             .norm();
    if (before > 0) {
      EXPECT_NEAR(std::log2(before / apart), 3.5, 0.7);  // h^3 of damping, h^4 of stiffness
    }
    before = apart;
  }
}

TEST(Integrators, MomentumIsKept) {
  const MassSpringModel model = small_model();
  const State start = lively(model);
  const Eigen::Vector3d momentum = start.v * model.mass;
  constexpr double kSolverTolerance = 1e-9;
  for (const Integrator& row : integrators()) {
    const std::string& integrator = row.name;
    const State end = advance(model, no_forces(model), integrator, start, 1e-3, 50);
    EXPECT_LT((end.v * model.mass - momentum).norm(), kSolverTolerance * start.v.norm()) << integrator;
  }
}

TEST(Integrators, MidpointKeepsTheEnergyOfLongRunsBounded) {
  const MassSpringModel model = small_model();
  constexpr int kSteps = 10000;
  constexpr double kDrift = 0.02;
  State state = lively(model);
  const Forces forces = no_forces(model);
  TimeStepper stepper(model, forces, "midpoint", 1);
  const double before = energy_of(model, state);
  double largest = 0;
  for (int i = 0; i < kSteps; ++i) {
    stepper.step(state, 5e-3);
    largest = std::max(largest, std::abs(energy_of(model, state) / before - 1));
  }
  EXPECT_LT(largest, kDrift);
  EXPECT_GT(largest, 1e-9);  // something moved
}

TEST(Integrators, MinimisingEulerNeverBlowsUpNorGainsEnergyFromAnyStart) {
  for (double stiffness : {1e1, 1e4, 1e7})
    for (double h : {1e-3, 1e-1, 1.}) {
      const MassSpringModel model = small_model(stiffness);
      const Forces forces = no_forces(model);
      State state = initial_state(model);
      state.x = random_points(5, 1, 23);
      state.x.row(2).setZero();  // flattened and tangled
      TimeStepper stepper(model, forces, "minimising_euler", 1);
      for (int i = 0; i < 20; ++i) {
        const double before = energy_of(model, state);
        EXPECT_EQ(stepper.step(state, h).status, Status::Ok) << stiffness << ' ' << h;
        EXPECT_LE(energy_of(model, state), before * (1 + kNewtonTolerance)) << stiffness << ' ' << h;
      }
    }
}

/// Through which every way leads, so that no step is found. Counts those that are sought.
class Wall : public SurfaceEnergy {
 public:
  double energy(const Matrix3Xd&) const override { return 0; }
  void add_forces(const Matrix3Xd&, Matrix3Xd&) const override {}
  void add_hessian(const Matrix3Xd&, SurfaceHessian&, Curvature) const override {}
  bool bounds_steps() const override { return true; }
  bool passes_through(const Matrix3Xd&, const Matrix3Xd&) const override {
    ++n_sought;
    return true;
  }
  mutable int n_sought = 0;
};

TEST(Integrators, AStepThatIsNotFoundIsCutDownToASixtyFourthOnce) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  const auto wall = std::make_shared<Wall>();
  forces.surface.push_back(wall);
  TimeStepper stepper(model, forces, "minimising_euler", 1);
  State state = initial_state(model);
  const StepReport report = stepper.step(state, 0.01);
  EXPECT_EQ(report.status, Status::NotConverged);
  EXPECT_TRUE(report.is_halved);
  EXPECT_EQ(wall->n_sought, 7 + 6) << "the step and six halvings, then the other half of each";
}

TEST(Integrators, ConstrainedDirectionsAreExact) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  const Eigen::Vector3d p = Eigen::Vector3d(1, 2, -2) / 3;
  forces.load = random_points(5, 5, 8);
  forces.constraints.push_back({0, Eigen::Matrix3d::Zero(), Eigen::Vector3d(0.1, 0, 0.2)});
  forces.constraints.push_back({3, Eigen::Matrix3d::Identity() - p * p.transpose(), Eigen::Vector3d::Zero()});
  constexpr int kSteps = 20;
  for (const Integrator& row : integrators()) {
    const std::string& integrator = row.name;
    const State end = advance(model, forces, integrator, initial_state(model), 1. / 500, kSteps);
    const double fraction = kSteps / 500.;
    EXPECT_LT((end.x.col(0) - model.network.X.col(0) - fraction * Eigen::Vector3d(0.1, 0, 0.2)).norm(),
              kRounding)
        << integrator;
    EXPECT_LT(std::abs(p.dot(end.x.col(3) - model.network.X.col(3))), kRounding) << integrator;
    EXPECT_GT((end.x.col(3) - model.network.X.col(3)).norm(), 1e-4) << integrator;
  }
}

TEST(Integrators, SupportsFollowTheirMotion) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  const Path path{{0, 0, 0, 0}, {0.01, 0.1, 9, 0}, {0.03, 0.05, 9, 0}};
  Constraint constrained{0,
                         Eigen::Matrix3d::Identity() - Eigen::Vector3d::UnitX() * Eigen::RowVector3d::UnitX(),
                         Eigen::Vector3d::Zero()};
  constrained.motion[0] = std::make_shared<const Path>(path);
  forces.constraints.push_back(constrained);
  constexpr double h = 0.001;
  for (const Integrator& row : integrators()) {
    const std::string& integrator = row.name;
    TimeStepper stepper(model, forces, integrator, 1);
    State state = initial_state(model);
    for (int n = 1; n <= 40; ++n) {
      ASSERT_EQ(stepper.step(state, h).status, Status::Ok) << integrator;
      const double speed = n <= 10 ? 10 : n <= 30 ? -2.5 : 0;
      EXPECT_NEAR(state.x(0, 0) - model.network.X(0, 0), position_at(path, n * h)(0), kRounding)
          << integrator;
      EXPECT_NEAR(state.v(0, 0), speed, 1e-9) << integrator << n;
    }
  }
}

TEST(Integrators, ALinearisedStepWithoutFiniteForcesDiverges) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  add_volume_penalty(1e3, model, forces);
  State state = lively(model);
  state.target_volume = -1;  // of a body that has turned inside out
  const State before = state;
  TimeStepper stepper(model, forces, "implicit_euler", 1);
  EXPECT_EQ(stepper.step(state, 0.01).status, Status::Diverged);
  EXPECT_EQ(state.x, before.x);
}

TEST(Integrators, DivergenceIsAStatusAndLeavesTheLastSoundState) {
  const MassSpringModel model = small_model(1e8);
  const Forces forces = no_forces(model);
  State state = lively(model);
  TimeStepper stepper(model, forces, "explicit_euler", 1);
  Status status = Status::Ok;
  for (int i = 0; i < 1000 && status == Status::Ok; ++i) status = stepper.step(state, 1).status;
  EXPECT_EQ(status, Status::Diverged);
  EXPECT_TRUE(state.x.allFinite() && state.v.allFinite());
}

TEST(Integrators, ErrorFollowsTheTolerance) {
  const MassSpringModel model = small_model();
  const Forces forces = no_forces(model);
  const State start = lively(model);
  constexpr double kEnd = 0.32, kSlopeTolerance = 0.2;  // parts of a step are whole in number
  const State exact = advance(model, forces, "rk4", start, kEnd / 4096, 4096);
  const std::vector<std::pair<std::string, double>> orders{
      {"symplectic_euler", 1}, {"implicit_euler", 1}, {"tr_bdf2", 2}, {"rk4", 4}};
  for (const auto& [integrator, order] : orders) {
    const auto error = [&, integrator = integrator](double tolerance) {
      IntegratorOptions options{1e-13};
      options.tolerance = tolerance;
      TimeStepper stepper(model, forces, integrator, 1, options);
      State state = start;
      for (int i = 0; i < 4; ++i) EXPECT_EQ(stepper.step(state, kEnd / 4).status, Status::Ok);
      EXPECT_DOUBLE_EQ(state.t, kEnd);
      return (state.x - exact.x).norm();
    };
    constexpr double kRatio = 256;
    const double tolerance = order == 4 ? 1e-7 : 1e-4;
    const double loose = error(tolerance), tight = error(tolerance / kRatio);
    // A part errs by its length to the power order + 1, all of them together by one power less.
    EXPECT_NEAR(std::log(loose / tight) / std::log(kRatio), order / (order + 1), kSlopeTolerance)
        << integrator;
  }
}

// One step and two halves are what a tolerance compares. Richardson's estimate of the error that the halves
// make is exact for short steps: theirs is the state that is kept if it is below the tolerance, and only
// then.
TEST(Integrators, AStepIsTakenInTwoHalvesJustWhereTheirErrorIsBelowTheTolerance) {
  const MassSpringModel model = small_model();
  const Forces forces = no_forces(model);
  const State start = lively(model);
  const double size = std::sqrt(3.);  // of the body's box
  for (const auto& [integrator, h] : {std::pair("symplectic_euler", 1e-3), std::pair("implicit_euler", 1e-3),
                                      std::pair("tr_bdf2", 4e-3), std::pair("rk4", 5e-3)}) {
    const Matrix3Xd exact = advance(model, forces, "rk4", start, h / 256, 256).x;
    const Matrix3Xd halves = advance(model, forces, integrator, start, h / 2, 2).x;
    const double error = (halves - exact).colwise().norm().maxCoeff() / size;
    for (const double factor : {0.8, 1.25}) {
      IntegratorOptions options{1e-13};
      options.tolerance = factor * error;
      TimeStepper stepper(model, forces, integrator, 1, options);
      State state = start;
      EXPECT_EQ(stepper.step(state, h).status, Status::Ok);
      const bool are_kept = (state.x - halves).norm() < 1e-3 * error;
      EXPECT_EQ(are_kept, factor > 1) << integrator << ' ' << factor;
    }
  }
}

TEST(Integrators, AToleranceIsRefusedWhereAStepRemembersTheOneBefore) {
  const MassSpringModel model = small_model();
  const Forces forces = no_forces(model);
  IntegratorOptions options;
  options.tolerance = 1e-4;
  EXPECT_THROW(TimeStepper(model, forces, "bdf2", 1, options), std::runtime_error);
  const Contacts contacts{{}, 0.1};
  EXPECT_THROW(TimeStepper(model, forces, "minimising_euler", 1, options, contacts), std::runtime_error);
}

TEST(Integrators, ABodyAtRestIsNotSteppedUntilAForceActs) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  forces.mass_damping = 20;
  IntegratorOptions options;
  options.sleep_below = 1e-3;
  TimeStepper stepper(model, forces, "minimising_euler", 1, options);
  State state = lively(model);
  int n_awake = 0;
  while (!stepper.step(state, 0.02).is_at_rest && n_awake < 1000) ++n_awake;
  EXPECT_GT(n_awake, 10);
  EXPECT_LT(n_awake, 1000);
  const Matrix3Xd before = state.x;
  EXPECT_TRUE(stepper.step(state, 0.02).is_at_rest);
  EXPECT_EQ(state.x, before);
  state.rest_length *= 1.1;
  EXPECT_FALSE(stepper.step(state, 0.02).is_at_rest);
  EXPECT_NE(state.x, before);
}

// A weight that a spring holds: at the support the spring pulls without end.
TEST(Integrators, ABodyThatHangsFromASupportComesToRest) {
  Oscillator o;
  o.forces.mass_damping = 5;
  const double weight = 0.2;
  o.forces.load(0, 1) = weight;
  IntegratorOptions options;
  options.sleep_below = 1e-3;
  TimeStepper stepper(o.model, o.forces, "minimising_euler", 1, options);
  State state = o.start;
  bool is_at_rest = false;
  while (state.t < 10 && !is_at_rest) is_at_rest = stepper.step(state, 0.02).is_at_rest;
  EXPECT_TRUE(is_at_rest);
  const double stiffness = o.model.springs->stiffness(0);
  // Less than what makes 2 kg move at the speed of sleep within a second is left.
  EXPECT_NEAR(state.x(0, 1) - 1, weight / stiffness, 2 * options.sleep_below / stiffness);
  EXPECT_GT(weight, 10 * 2 * options.sleep_below);
}

TEST(Integrators, ABodyAtRestWakesWhenAnObstacleMoves) {
  const MassSpringModel model = small_model();
  const Forces forces = no_forces(model);
  Obstacle piston;  // comes from x = 1.05 from t = 0.1 on
  piston.shape = HalfSpace{{1.05, 0, 0}, {-1, 0, 0}};
  piston.motion = {{0, 0, 0, 0}, {0.1, 0, 0, 0}, {0.3, -0.2, 0, 0}};
  Contacts contacts;
  contacts.bodies.emplace_back(piston);
  IntegratorOptions options;
  options.sleep_below = 1e-3;
  for (const char* integrator : {"symplectic_euler", "implicit_euler", "minimising_euler"}) {
    TimeStepper stepper(model, forces, integrator, 1, options, contacts);
    State state = initial_state(model);
    for (int i = 0; i < 30; ++i)
      EXPECT_EQ(stepper.step(state, 0.01).is_at_rest, i < 10) << integrator << ' ' << i;
    EXPECT_LT(state.x(0, 1), 0.851) << integrator << ": the piston went through it";
  }
}

TEST(Integrators, ABodyAtRestWakesWhenItsSupportMoves) {
  Oscillator o;
  o.start.x = o.model.network.X;
  const Path path{{0, 0, 0, 0}, {0.105, 0, 0, 0}, {0.305, 0.2, 0, 0}};
  o.forces.constraints[0].motion[0] = std::make_shared<const Path>(path);
  IntegratorOptions options;
  options.sleep_below = 1e-3;
  TimeStepper stepper(o.model, o.forces, "minimising_euler", 1, options);
  State state = o.start;
  for (int i = 0; i < 30; ++i) {
    EXPECT_EQ(stepper.step(state, 0.01).is_at_rest, i < 10) << i;
    EXPECT_NEAR(state.x(0, 0), position_at(path, state.t)(0), kRounding);
  }
  EXPECT_GT(state.x(0, 1), 1.01);
}

TEST(Integrators, ASwingTurningIsNotAtRest) {
  const Oscillator o;
  IntegratorOptions options;
  options.sleep_below = 1e-3;
  TimeStepper stepper(o.model, o.forces, "midpoint", 1, options);
  State state = o.start;  // at its turning point
  EXPECT_FALSE(stepper.step(state, 1e-6).is_at_rest);
}

TEST(Integrators, DroppedGradientsAndEitherLinearSolverLeadToTheSameMotion) {
  MassSpringModel model = small_model();
  model.bending = make_bending(model.network.X, model.network.F, 3);
  model.local_volume = LocalVolume{30, Eigen::Vector4i(0, 1, 2, 3), Eigen::VectorXd::Constant(1, 1. / 6)};
  Forces forces = no_forces(model);
  add_volume_penalty(20, model, forces);
  constexpr double kEnd = 0.02, kSlopeTolerance = 0.1, kLinearTolerance = 1e-13;
  const State start = lively(model), exact = advance(model, forces, "rk4", start, kEnd / 1024, 1024);
  const auto run = [&](bool is_kept, Krylov krylov, int n_steps) {
    IntegratorOptions options{kLinearTolerance, {is_kept, is_kept}, krylov};
    TimeStepper stepper(model, forces, "implicit_euler", 1, options);
    State state = start;
    for (int i = 0; i < n_steps; ++i) EXPECT_EQ(stepper.step(state, kEnd / n_steps).status, Status::Ok);
    return state.x;
  };
  for (bool is_kept : {true, false}) {
    const Matrix3Xd coarse = run(is_kept, Krylov::Cg, 32), fine = run(is_kept, Krylov::Cg, 64);
    EXPECT_NEAR(std::log2((coarse - exact.x).norm() / (fine - exact.x).norm()), 1, kSlopeTolerance);
    for (const Krylov other : {Krylov::BiCg, Krylov::BiCgStab})
      EXPECT_LT((run(is_kept, other, 32) - coarse).norm(), 1e-10);
  }
  EXPECT_GT((run(true, Krylov::Cg, 32) - run(false, Krylov::Cg, 32)).norm(), 1e-6);
}

TEST(StableStep, IsTheLimitOfSymplecticEuler) {
  const MassSpringModel model = small_model();
  Forces forces = no_forces(model);
  forces.mass_damping = 2;
  add_volume_penalty(500, model, forces);  // so that its stiffness counts
  const double limit = stable_step(model, forces, initial_state(model));
  for (double factor : {0.98, 1.02}) {
    State state = initial_state(model);
    state.x += random_points(5, 1e-9, 3);
    TimeStepper stepper(model, forces, "symplectic_euler", 1);
    for (int i = 0; i < 300; ++i) stepper.step(state, factor * limit);
    const bool has_grown = (state.x - model.network.X).norm() > 1e-6;
    EXPECT_EQ(has_grown, factor > 1) << factor;
  }
}

TEST(TimeStepper, RefusesABodyWithoutExtent) {
  MassSpringModel model = small_model();
  model.network.X.colwise() = Eigen::Vector3d(1, 2, 3);
  const Forces forces = no_forces(model);
  EXPECT_THROW(TimeStepper(model, forces, "minimising_euler", 1), std::runtime_error);
}

}  // namespace
}  // namespace testbed::massspring
