#include <gtest/gtest.h>

#include <cmath>

#include "massspring/calibrations/calibrate.h"
#include "massspring/statics/quasi_static.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "tests/massspring/linear_box.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

constexpr double kStiffness = 100;  // N/m
constexpr double kRounding = 1e-12;
constexpr double kTolerance = 1e-6;  // the solver's balance of forces is 1e-8 of the load

/// Springs of equal stiffness between the nodes, each of 1 kg.
MassSpringModel springs_between(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E) {
  MassSpringModel model;
  model.network = {X, Eigen::Matrix4Xi(4, 0), Eigen::Matrix3Xi(3, 0), static_cast<int>(X.cols())};
  model.mass = Eigen::VectorXd::Ones(X.cols());
  model.springs.emplace();
  model.springs->E = E;
  model.springs->stiffness = Eigen::VectorXd::Constant(E.cols(), kStiffness);
  return model;
}

Forces no_load(const MassSpringModel& model) {
  Forces forces;
  forces.load = Eigen::Matrix3Xd::Zero(3, model.network.X.cols());
  return forces;
}

/// A tetrahedron of six springs and, tied to its corners by `n_ties` springs, a fifth node.
MassSpringModel tied_node(int n_ties) {
  Eigen::Matrix3Xd X(3, 5);
  X << 0, 1, 0, 0, 1,  //
      0, 0, 1, 0, 1,   //
      0, 0, 0, 1, 1;
  Eigen::Matrix2Xi E(2, 6 + n_ties);
  E.leftCols(6) << 0, 0, 0, 1, 1, 2,  //
      1, 2, 3, 2, 3, 3;
  for (int k = 0; k < n_ties; ++k) E.col(6 + k) << k + 1, 4;
  return springs_between(X, E);
}

TEST(QuasiStatic, CountsTheMotionsThatCostNoEnergy) {
  for (int n_ties : {1, 2, 3}) {
    const MassSpringModel model = tied_node(n_ties);
    const Forces forces = no_load(model);
    const QuasiStaticSolver solver(model, forces);
    EXPECT_EQ(solver.n_free_rigid_motions(), 6);
    EXPECT_EQ(solver.n_floppy_motions(), 3 - n_ties);
  }
}

TEST(QuasiStatic, SaysThatALoadDrownsInTheRoundingOfTheLengthsOfSprings) {
  const MassSpringModel model = tied_node(3);
  for (const double force : {1e-2, 1e-15}) {
    Forces forces = no_load(model);
    forces.load.col(4) << force, 0, 0;
    forces.load.leftCols<4>().colwise() = Eigen::Vector3d(-force / 4, 0, 0);
    for (int i = 0; i < 3; ++i)
      forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
    State state = initial_state(model);
    QuasiStaticSolver solver(model, forces);
    const StepReport report = solver.solve(1, state);
    EXPECT_EQ(report.status, force > 1e-10 ? Status::Ok : Status::NotConverged);
    if (force < 1e-10) {
      EXPECT_NE(report.reason.find("rounding"), std::string::npos) << report.reason;
    }
  }
}

/// Bodies of tied_node side by side.
MassSpringModel tied_nodes(int n_ties, int n_bodies) {
  const TetMesh one = tied_node(n_ties).network;
  const Eigen::Matrix2Xi E = tied_node(n_ties).springs->E;
  Eigen::Matrix3Xd X(3, n_bodies * one.X.cols());
  Eigen::Matrix2Xi all(2, n_bodies * E.cols());
  for (int k = 0; k < n_bodies; ++k) {
    X.middleCols(k * one.X.cols(), one.X.cols()) = one.X.colwise() + Eigen::Vector3d(3 * k, 0, 0);
    all.middleCols(k * E.cols(), E.cols()) = E.array() + static_cast<int>(k * one.X.cols());
  }
  return springs_between(X, all);
}

TEST(QuasiStatic, CountsMoreMotionsThatCostNoEnergyThanItLooksForAtFirst) {
  constexpr int kBodies = 10, kOfOne = 6 + 2;  // moves as a rigid body, and its tied node in two directions
  const MassSpringModel model = tied_nodes(1, kBodies);
  EXPECT_EQ(QuasiStaticSolver(model, no_load(model)).n_floppy_motions(), kBodies * kOfOne - 6);
}

TEST(HasFloppyMotions, OfNodesAloneOfBodiesAndOfNone) {
  constexpr double kNoFactor = 10;
  EXPECT_EQ(has_floppy_motions(tied_node(2), {}, kNoFactor), true) << "a node's own springs tell it";
  EXPECT_EQ(has_floppy_motions(tied_node(3), {}), false);
  EXPECT_EQ(has_floppy_motions(tied_node(3), {}, kNoFactor), std::nullopt);
  EXPECT_EQ(has_floppy_motions(tied_nodes(3, 2), {}), true) << "one body moves beside the other";
  const Eigen::Vector3d free = Eigen::Vector3d(1, 0, 0);  // across the ties
  const std::vector<Constraint> held{{4, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()}};
  EXPECT_EQ(has_floppy_motions(tied_node(2), held, kNoFactor), std::nullopt) << "no node is loose";
  const std::vector<Constraint> sliding{{4, free * free.transpose(), Eigen::Vector3d::Zero()}};
  EXPECT_EQ(has_floppy_motions(tied_node(1), sliding, kNoFactor), true);
}

TEST(QuasiStatic, SpringCarriesTheLoadAlongItAndFloppyMotionsAreConstrained) {
  const MassSpringModel model = tied_node(1);
  Forces forces = no_load(model);
  for (int i : {0, 1, 2, 3})
    forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  const Eigen::Vector3d along = Eigen::Vector3d(0, 1, 1).normalized(), across = Eigen::Vector3d::UnitX();
  forces.load.col(4) = 4 * along + 3 * across;  // the part across meets no stiffness
  QuasiStaticSolver solver(model, forces);
  EXPECT_EQ(solver.n_free_rigid_motions(), 0);
  EXPECT_EQ(solver.n_floppy_motions(), 2);
  EXPECT_NEAR(solver.floppy_load_share(), 3.0 / 5, kTolerance);
  State state = initial_state(model);
  EXPECT_EQ(solver.solve(0.5, state).status, Status::Ok);
  const Eigen::Vector3d moved = state.x.col(4) - model.network.X.col(4);
  EXPECT_LT((moved - 0.5 * 4 / kStiffness * along).norm(), kTolerance);
}

TEST(QuasiStatic, MovesPrescribedNodesAndTheBodyWithThem) {
  const MassSpringModel model = tied_node(3);
  Forces forces = no_load(model);
  const Eigen::Vector3d shift(0.1, 0.2, -0.3);
  for (int i : {0, 1, 2}) forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), shift});
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  EXPECT_EQ(solver.solve(1, state).status, Status::Ok);
  EXPECT_LT((state.x - model.network.X).colwise().operator-(shift).norm(), kTolerance);
}

TEST(QuasiStatic, SupportsFollowTheirMotionOverTheLoadFactor) {
  const MassSpringModel model = tied_node(3);
  Forces forces = no_load(model);
  const auto path = std::make_shared<const Path>(Path{{0, 0, 0, 0}, {0.5, 0.1, 0.2, -0.3}, {1, 0.2, 0, 0}});
  for (int i : {0, 1, 2})
    forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), {0, 0, 0}, {0, 0, 0}, {path, path, path}});
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  for (const auto& [load_factor, shift] : {std::pair(0.5, Eigen::Vector3d(0.1, 0.2, -0.3)),
                                           std::pair(0.75, Eigen::Vector3d(0.15, 0.1, -0.15))}) {
    EXPECT_EQ(solver.solve(load_factor, state).status, Status::Ok);
    EXPECT_LT((state.x - model.network.X).colwise().operator-(shift).norm(), kTolerance);
  }
}

/// A box of 2 m x m x m cubes of 0.25 m.
MassSpringModel box_of(const std::string& calibration, int m, double jitter) {
  const TetMesh mesh = box_tets(2 * m, m, m, 0.25, jitter);
  SpringNetwork network;
  network.X = mesh.X;
  network.F = mesh.F;
  network.T = mesh.T;
  network.n_surface = static_cast<int>(mesh.X.cols());
  return calibrate(network, {1e8, 0.25, 1000, 0}, find_calibration(calibration));
}

// Forces and their scale are rounding, then: there is nothing to balance.
TEST(QuasiStatic, WithoutAnyLoadABodyStaysAtRest) {
  for (const char* calibration : {"van_gelder", "moment", "edge_coupled", "node_averaged"})
    for (const double offset : {0., 0.3, 20.})
      for (const bool is_constrained : {false, true}) {
        MassSpringModel model = box_of(calibration, 1, 0.2);
        model.network.X.array() += offset;
        Forces forces = no_load(model);
        for (int i = 0; is_constrained && i < 12; i += 3)
          forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
        QuasiStaticSolver solver(model, forces);
        State state = initial_state(model);
        for (const double load_factor : {0., 0.5, 1.}) {
          const StepReport report = solver.solve(load_factor, state);
          EXPECT_EQ(report.status, Status::Ok)
              << calibration << ' ' << offset << ' ' << is_constrained << report.reason;
          EXPECT_LE(report.residual, TimeOptions().residual);
          EXPECT_LT((state.x - model.network.X).norm(), kRounding * model.network.X.norm());
        }
      }
}

// Without a load only its internal forces tell how much of the rest is rounding.
TEST(QuasiStatic, ABoxThatSupportsHoldStretchedIsInBalanceAgain) {
  const MassSpringModel model = full_box("node_averaged");
  Forces forces = no_load(model);
  const double end = model.network.X.row(0).maxCoeff();
  for (int i = 0; i < model.network.X.cols(); ++i)
    if (const double x = model.network.X(0, i); x < 0.01 || x == end)
      forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d(0.2 * x, 0.1 * x, 0)});
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  ASSERT_EQ(solver.solve(1, state).status, Status::Ok);
  const StepReport report = solver.solve(1, state);
  EXPECT_EQ(report.status, Status::Ok) << report.reason;
  EXPECT_EQ(report.newton_iterations, 0);
}

TEST(QuasiStatic, DivergesFromAStateThatIsNotFiniteAndRecovers) {
  for (const char* calibration : {"van_gelder", "node_averaged"}) {
    const MassSpringModel model = box_of(calibration, 1, 0.2);
    Forces forces = no_load(model);
    for (int i = 0; i < 12; i += 3)
      forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
    QuasiStaticSolver solver(model, forces);
    for (const double bad : {std::nan(""), HUGE_VAL}) {
      State state = initial_state(model);
      state.x(1, 4) = bad;
      const StepReport report = solver.solve(0.5, state);
      EXPECT_EQ(report.status, Status::Diverged) << calibration << ' ' << bad;
      EXPECT_FALSE(report.residual <= TimeOptions().residual);
      state = initial_state(model);
      EXPECT_EQ(solver.solve(0.5, state).status, Status::Ok);
    }
  }
}

TEST(QuasiStatic, ALoadMayBeNothingAtOneLoadFactorAndComeBack) {
  const MassSpringModel model = tied_node(1);
  Forces forces = no_load(model);
  for (int i : {0, 1, 2, 3})
    forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  const Eigen::Vector3d along = Eigen::Vector3d(0, 1, 1).normalized();
  forces.load.col(4) = 4 * along;
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  for (const double load_factor : {0., 0.5, 0., 1., -0.5, 0., 1e-6}) {
    const StepReport report = solver.solve(load_factor, state);
    EXPECT_EQ(report.status, Status::Ok) << load_factor << report.reason;
    const Eigen::Vector3d expected = load_factor * 4 / kStiffness * along;
    EXPECT_LT((state.x.col(4) - model.network.X.col(4) - expected).norm(), 1e-9) << load_factor;
  }
}

// Stretched by its supports it is in balance without a load: what its springs pull at them is the scale.
TEST(QuasiStatic, ABodyThatSupportsHoldStretchedIsInBalanceAgain) {
  const MassSpringModel model = tied_node(1);
  Forces forces = no_load(model);
  for (int i : {0, 1, 2, 3})
    forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), 0.2 * model.network.X.col(i)});
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  ASSERT_EQ(solver.solve(1, state).status, Status::Ok);
  const Eigen::Matrix3Xd x = state.x;
  for (int again = 0; again < 2; ++again) {
    const StepReport report = solver.solve(1, state);
    EXPECT_EQ(report.status, Status::Ok) << report.reason;
    EXPECT_EQ(report.newton_iterations, 0);
    EXPECT_LT((state.x - x).norm(), kTolerance);
  }
}

TEST(QuasiStatic, StartsWhereTheLastEquilibriaPointAndEndsWhereOneStepDoes) {
  const MassSpringModel model = box_of("node_averaged", 2, 0);
  Forces forces;
  forces.load = Eigen::Vector3d(0, -9.81, 0) * model.mass.transpose();
  for (int i = 0; i < model.network.X.cols(); ++i)
    if (model.network.X(0, i) == 0)
      forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  constexpr double kLoose = 1e-8;  // that the extrapolated state is nearly within
  QuasiStaticSolver in_steps(model, forces, kLoose), at_once(model, forces, kLoose);
  State state = initial_state(model), whole = state;
  std::vector<int> iterations;
  for (double load_factor : {0.2, 0.4, 0.6, 0.8, 1.0}) {
    const StepReport report = in_steps.solve(load_factor, state);
    ASSERT_EQ(report.status, Status::Ok);
    iterations.push_back(report.newton_iterations);
  }
  const StepReport report = at_once.solve(1, whole);
  ASSERT_EQ(report.status, Status::Ok);
  EXPECT_GT((whole.x - model.network.X).norm(), 1e-4);
  EXPECT_LT((state.x - whole.x).norm(), kTolerance * (whole.x - model.network.X).norm());
  EXPECT_GE(iterations.front(), 2);
  EXPECT_LE(iterations.back(), 1);
}

/// A beam of 540 nodes that bends by half its length under its own weight, constrained at one end.
struct SoftBeam {
  MassSpringModel model;
  Forces forces;

  explicit SoftBeam(const char* calibration) : model(box_of(calibration, 5, 0.1)) {
    model = softened(calibration);
    forces.load = Eigen::Vector3d(0, -9.81, 0) * model.mass.transpose();
    for (int i = 0; i < model.network.X.cols(); ++i)
      if (model.network.X(0, i) < 0.1)
        forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  }
  MassSpringModel softened(const char* calibration) const {
    SpringNetwork network;
    network.X = model.network.X;
    network.F = model.network.F;
    network.T = model.network.T;
    network.n_surface = model.network.n_surface;
    return calibrate(network, {2e5, 0.25, 1000, 0}, find_calibration(calibration));
  }
};

TEST(QuasiStatic, OneStepAndManyEndAtTheSameLargeBendInFewIterations) {
  for (const char* calibration : {"edge_coupled", "node_averaged"}) {
    const SoftBeam beam(calibration);
    ASSERT_GE(beam.model.network.X.cols(), 396);
    QuasiStaticSolver in_steps(beam.model, beam.forces), at_once(beam.model, beam.forces);
    State state = initial_state(beam.model), whole = state;
    int n_newton = 0;
    for (const double load_factor : {0.25, 0.5, 0.75, 1.}) {
      const StepReport report = in_steps.solve(load_factor, state);
      ASSERT_EQ(report.status, Status::Ok) << report.reason;
      n_newton += report.newton_iterations;
    }
    EXPECT_LE(n_newton, 24) << calibration;
    ASSERT_EQ(at_once.solve(1, whole).status, Status::Ok);
    const double bend = (whole.x - beam.model.network.X).colwise().norm().maxCoeff();
    EXPECT_GT(bend, 0.3);
    EXPECT_LT((state.x - whole.x).colwise().norm().maxCoeff(), kTolerance * bend);
  }
}

TEST(QuasiStatic, RefusesLoadsThatWouldDriveAFreeBodyAndNamesThem) {
  const MassSpringModel model = tied_node(3);
  Forces forces = no_load(model);
  forces.load.col(2) << 0, 0, 7;
  try {
    const QuasiStaticSolver solver(model, forces);
    FAIL() << "accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("leave 6 rigid motions free"), std::string::npos)
        << error.what();
    EXPECT_NE(std::string(error.what()).find("net force (0 0 7) N"), std::string::npos) << error.what();
    // The node lies (-0.4, 0.6, -0.4) m from the mean of all.
    EXPECT_NE(std::string(error.what()).find("net torque (4.2 2.8   0) N m"), std::string::npos)
        << error.what();
  }
}

// Six springs of a regular tetrahedron, side l, blown up by p: 6 k (l - l_0) = p dV/dl = p l^2/(2 sqrt 2),
// which has no solution beyond p = 3 sqrt 2 k/l_0, where l = 2 l_0.
TEST(QuasiStatic, BeyondALimitPointEndsSoonAndSaysWhy) {
  const double s = 1 / std::sqrt(2.0), limit = 3 * std::sqrt(2.0) * kStiffness;
  MassSpringModel model = tied_node(3);
  model.network.X.resize(3, 4);
  model.network.X << s, s, 0, 0,  //
      s, 0, s, 0,                 //
      s, 0, 0, s;
  model = springs_between(model.network.X - Eigen::Matrix3Xd::Constant(3, 4, s / 2),
                          model.springs->E.leftCols<6>());
  Forces forces = no_load(model);
  Eigen::Matrix3Xi F(3, 4);
  F << 1, 0, 0, 0,  //
      2, 1, 3, 2,   //
      3, 3, 2, 1;
  if (volume(model.network.X, F) < 0) F.row(0).swap(F.row(1));
  forces.surface.push_back(std::make_shared<FollowerPressure>(-limit, Faces{F}));
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  ASSERT_EQ(solver.solve(0.9, state).status, Status::Ok);
  const double l = (state.x.col(0) - state.x.col(1)).norm();
  EXPECT_NEAR(4 * (l - 1) / (l * l), 0.9, kTolerance);
  const StepReport report = solver.solve(1.1, state);
  EXPECT_EQ(report.status, Status::NotConverged);
  EXPECT_LT(report.newton_iterations, 100);
  EXPECT_NE(report.reason.find("runs away"), std::string::npos) << report.reason;
}

}  // namespace
}  // namespace testbed::massspring
