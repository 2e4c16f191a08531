#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <tuple>

#include "massspring/statics/quasi_static.h"
#include "meshing/algebra/rigid_motion.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/linear_box.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/flat_tetrahedra.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::VectorXd;

constexpr double kTight = 1e-13, kClose = 1e-10;  // of the solver's residual; of displacements

Matrix3Xd solve(const MassSpringModel& model, const Forces& forces, double tolerance = kTight) {
  QuasiStaticSolver solver(model, forces, tolerance);
  State state = initial_state(model);
  EXPECT_EQ(solver.solve(1, state).status, Status::Ok);
  return state.x - model.network.X;
}

/// Without supports, small strain.
MassSpringModel free_box(const TetMesh& box) {
  SpringNetwork network;
  network.X = box.X;
  network.F = box.F;
  network.T = box.T;
  network.n_surface = static_cast<int>(network.X.cols());
  MassSpringModel model = calibrate(network, {1e6, 0.25, 1000, 0}, find_calibration("node_averaged"));
  linearise(model);
  return model;
}

/// Loads that drive no rigid motion.
Forces balanced(const MassSpringModel& model) {
  const Matrix3Xd& X = model.network.X;
  Forces forces = no_forces(model);
  forces.load =
      meshing::without_rigid_motion(hanging(model).load.cwiseProduct(X), X, VectorXd::Ones(X.cols()));
  return forces;
}

TEST(LinearEquilibrium, IsThatOfADenseSolver) {
  for (const char* calibration : {"van_gelder", "edge_coupled", "node_averaged"}) {
    const MassSpringModel model = linear_box(calibration);
    Forces forces = hanging(model);
    forces.constraints.front().displacement = {0.01, 0.02, -0.03};
    const Eigen::MatrixXd K = dense_stiffness(model);
    VectorXd u = VectorXd::Zero(K.rows());
    u.segment<3>(3 * forces.constraints.front().node) = forces.constraints.front().displacement;
    const Eigen::VectorXi free = free_unknowns(model, forces);
    const VectorXd r = forces.load.reshaped() - K * u;
    const Eigen::MatrixXd K_free = K(free, free);
    u(free) = K_free.llt().solve(r(free).eval()).eval();
    EXPECT_LT((solve(model, forces).reshaped() - u).norm(), kClose * u.norm()) << calibration;
  }
}

TEST(LinearEquilibrium, DoublesWithTheLoad) {
  const MassSpringModel model = linear_box("node_averaged");
  const Matrix3Xd once = solve(model, hanging(model, 100)), twice = solve(model, hanging(model, 200));
  EXPECT_GT(once.colwise().norm().maxCoeff(), 0.01) << "far beyond what is small";
  EXPECT_LT((twice - 2 * once).norm(), 1e-12 * twice.norm());
}

TEST(LinearEquilibrium, OfProportionalStepsTakesOneSolve) {
  const MassSpringModel model = linear_box("node_averaged");
  const Forces forces = hanging(model);
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  int n_solves = 0;
  for (const double load_factor : {0.25, 0.5, 0.75, 1.0}) {
    const StepReport report = solver.solve(load_factor, state);
    EXPECT_LE(report.residual, TimeOptions().residual);
    n_solves += report.newton_iterations;
  }
  EXPECT_EQ(n_solves, 1);
  EXPECT_LT((state.x - model.network.X - solve(model, forces)).norm(), 1e-7 * solve(model, forces).norm());
}

TEST(LinearEquilibrium, OfSupportsThatMoveOnTheirPathIsFoundAtEveryStep) {
  const MassSpringModel model = linear_box("edge_coupled");
  Forces forces = hanging(model), still = forces;
  const auto path =
      std::make_shared<const Path>(Path{{0, 0, 0, 0}, {0.5, 0.02, 0.01, 0}, {1, 0.01, 0, -0.01}});
  for (Constraint& c : forces.constraints) c.motion = {path, path, path};
  QuasiStaticSolver solver(model, forces, kTight);
  State state = initial_state(model);
  const Matrix3Xd sagged = solve(model, still);
  for (const double load_factor : {0.25, 0.5, 0.8, 1.0}) {
    ASSERT_EQ(solver.solve(load_factor, state).status, Status::Ok);
    const Matrix3Xd expected = (load_factor * sagged).colwise() + position_at(*path, load_factor);
    EXPECT_LT((state.x - model.network.X - expected).norm(), kClose * expected.norm()) << load_factor;
  }
}

TEST(LinearEquilibrium, WhereSupportsOnlyMoveTheBodyIsReachedAtEveryStep) {
  const MassSpringModel model = linear_box("node_averaged");
  Forces forces = no_forces(model);
  for (const Constraint& c : hanging(model).constraints) forces.constraints.push_back(c);
  for (Constraint& c : forces.constraints) c.displacement = {1, 2, 3};
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  for (const double load_factor : {0.3, 0.6, 1.0}) {
    EXPECT_EQ(solver.solve(load_factor, state).status, Status::Ok);
    const Eigen::Vector3d shift = load_factor * Eigen::Vector3d(1, 2, 3);
    EXPECT_LT(((state.x - model.network.X).colwise() - shift).norm(), 1e-8);
  }
}

// Nodes of half the body lie ten times as dense.
TEST(LinearEquilibrium, OfAFreeBodyHasNoMomentaWhereverItsNodesAreDense) {
  TetMesh box = meshing::box_tets(8, 3, 3, 0.1);
  for (double& x : box.X.row(0)) x = x < 0.4 ? x / 10 : x - 0.36;
  const MassSpringModel model = free_box(box);
  const Matrix3Xd& X = model.network.X;
  const Matrix3Xd u = solve(model, balanced(model)), momenta = u * model.mass.asDiagonal();
  Eigen::Vector3d angular = Eigen::Vector3d::Zero(), of_sizes = angular;
  for (Eigen::Index i = 0; i < u.cols(); ++i) {
    angular += X.col(i).cross(momenta.col(i));
    of_sizes += X.col(i).cwiseAbs().cross(momenta.col(i)).cwiseAbs();
  }
  EXPECT_LT(momenta.rowwise().sum().norm(), kClose * momenta.cwiseAbs().sum());
  EXPECT_LT(angular.norm(), kClose * of_sizes.norm());
  EXPECT_GT(u.rowwise().sum().norm(), 0.01 * u.cwiseAbs().sum()) << "else nodes would do as well";
}

// Rounding along rigid motions would take a hundred iterations more. Soft motions of the slender one are beyond a
// preconditioner that is a millionth stiffer.
TEST(LinearEquilibrium, OfAFreeBodyTakesFewIterations) {
  for (const auto& [nx, ny, most] :
       {std::tuple(12, 12, 35), std::tuple(30, 8, 35), std::tuple(400, 2, 140)}) {
    const MassSpringModel model = free_box(meshing::box_tets(nx, ny, ny, 0.1));
    const Forces forces = balanced(model);
    QuasiStaticSolver solver(model, forces);
    State state = initial_state(model);
    const StepReport report = solver.solve(1, state);
    EXPECT_EQ(report.status, Status::Ok);
    EXPECT_LT(report.linear_iterations, most) << nx << " by " << ny << " by " << ny;
  }
}

TEST(LinearEquilibrium, OfAStiffBodyIsAsCloseAsThatOfASoftOne) {
  constexpr double kStiffer = 1e9;
  const Matrix3Xd soft = solve(linear_box("node_averaged"), hanging(linear_box("node_averaged")));
  const MassSpringModel model = linear_box("node_averaged", 2, 1e6 * kStiffer);
  const Forces forces = hanging(model);
  QuasiStaticSolver stiff(model, forces, kTight);
  State state = initial_state(model);
  ASSERT_EQ(stiff.solve(1, state).status, Status::Ok);
  EXPECT_LT((kStiffer * displacement(model, state) - soft).norm(), kClose * soft.norm());
}

TEST(LinearEquilibrium, IsWhatFullGeometryTendsToHoweverSmallTheLoad) {
  const MassSpringModel linear = linear_box("node_averaged");
  MassSpringModel full = linear;
  full.linear = nullptr;
  Forces forces = hanging(linear);
  const Matrix3Xd load = forces.load, expected = solve(linear, forces);
  for (const double factor : {1e-12, 1e-8, 1e-4}) {
    forces.load = factor * load;
    QuasiStaticSolver solver(full, forces, kTight);
    State state = initial_state(full);
    ASSERT_EQ(solver.solve(1, state).status, Status::Ok) << factor;
    const Matrix3Xd u = displacement(full, state);
    EXPECT_LT((u / factor - expected).norm(), (1e-9 + factor) * expected.norm()) << factor;
    EXPECT_NEAR(largest_strain(full.network.X, full.network.T, u) / factor,
                largest_linear_strain(full.network.X, full.network.T, expected), 1e-4)
        << factor;
  }
}

TEST(LinearEquilibrium, OfABodyThatShrinksEvenlyIsFreeOfForces) {
  for (const char* calibration : {"van_gelder", "node_averaged"}) {
    const MassSpringModel model = linear_box(calibration);
    const Forces forces = no_forces(model);
    QuasiStaticSolver solver(model, forces, kTight);
    State state = initial_state(model);
    for (const double shrinkage : {0.1, 0.2}) {
      state.rest_length = (1 - shrinkage) * initial_state(model).rest_length;
      if (model.tet_springs)
        state.patch_scale = VectorXd::Constant(model.tet_springs->n_patches(), 1 - shrinkage);
      ASSERT_EQ(solver.solve(5 * shrinkage, state).status, Status::Ok);
      const Matrix3Xd& X = model.network.X;
      const Eigen::Vector3d centre = X * model.mass / model.mass.sum();
      const Matrix3Xd shrunk = ((1 - shrinkage) * (X.colwise() - centre)).colwise() + centre;
      EXPECT_LT((state.x - shrunk).norm(), kClose) << calibration;
      EXPECT_LT(elastic_energy(model, state), 1e-12 * model.material.E) << calibration;
    }
  }
}

TEST(LinearEquilibrium, OfANearlyIncompressibleBodyIsFound) {
  const MassSpringModel model = linear_box("node_averaged", 4, 1e6, 0.499);
  const Forces forces = hanging(model);
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  const StepReport report = solver.solve(1, state);
  EXPECT_EQ(report.status, Status::Ok);
  EXPECT_LE(report.linear_iterations, 130) << "a matrix of its own preconditions it";
}

MassSpringModel with_flat_tetrahedra(const char* calibration, double part_of_volume) {
  const TetMesh box = meshing::box_tets(12, 6, 6, 0.25 / 6, 0.2);
  SpringNetwork network;
  network.X = box.X;
  network.F = box.F;
  network.T = box.T;
  meshing::add_flat_tetrahedra(network, part_of_volume);
  network.n_surface = static_cast<int>(network.X.cols());
  MassSpringModel model = calibrate(network, {1e6, 0.25, 1000, 0}, find_calibration(calibration));
  linearise(model);
  return model;
}

TEST(LinearEquilibrium, OfFlatTetrahedraIsThatOfADenseSolver) {
  for (const char* calibration : {"edge_coupled", "node_averaged"}) {
    const MassSpringModel model = with_flat_tetrahedra(calibration, 1e-10);
    const Forces forces = hanging(model);
    QuasiStaticSolver solver(model, forces);
    State state = initial_state(model);
    EXPECT_EQ(solver.solve(1, state).status, Status::Ok) << calibration;
    const Eigen::VectorXi free = free_unknowns(model, forces);
    const Eigen::MatrixXd K = dense_stiffness(model)(free, free);
    const VectorXd u = K.llt().solve(VectorXd(forces.load.reshaped()(free)));
    EXPECT_LT((displacement(model, state).reshaped()(free) - u).norm(), 1e-4 * u.norm()) << calibration;
  }
}

// Alone they are far stiffer than averages leave them, and would take hundreds of iterations.
TEST(LinearEquilibrium, FlatTetrahedraCostNoIterations) {
  for (const char* calibration : {"edge_coupled", "node_averaged"})
    for (const double part_of_volume : {1e-2, 1e-4, 1e-6}) {
      const MassSpringModel model = with_flat_tetrahedra(calibration, part_of_volume);
      const Forces forces = hanging(model);
      QuasiStaticSolver solver(model, forces);
      State state = initial_state(model);
      const StepReport report = solver.solve(1, state);
      EXPECT_EQ(report.status, Status::Ok);
      EXPECT_LT(report.linear_iterations, 60) << calibration << ' ' << part_of_volume;
    }
}

// The rounding of forces is larger than the load there, and says nothing of other nodes.
TEST(LinearEquilibrium, BesideFlatTetrahedraIsFoundFromElsewhere) {
  for (const double part_of_volume : {1e-12, 1e-13, 1e-14}) {
    const MassSpringModel model = with_flat_tetrahedra("edge_coupled", part_of_volume);
    const Forces forces = hanging(model);
    QuasiStaticSolver solver(model, forces, 1e-6);
    State state = initial_state(model);
    EXPECT_EQ(solver.solve(1, state).status, Status::Ok);
    const Matrix3Xd u = displacement(model, state);
    solver.start_at(0.9 * u, state);
    EXPECT_EQ(solver.solve(1, state).status, Status::Ok);
    EXPECT_LT((displacement(model, state) - u).norm(), 1e-7 * u.norm()) << part_of_volume;
  }
}

// Solves after one that stood still would spend as many iterations each.
TEST(LinearEquilibrium, TurnsToAFactorAfterOneSolveThatStoodStill) {
  const MassSpringModel model = with_flat_tetrahedra("edge_coupled", 1e-12);
  const Forces forces = hanging(model);
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  const StepReport report = solver.solve(1, state);
  EXPECT_EQ(report.status, Status::Ok);
  EXPECT_EQ(solver.solver_choice(), "Cholesky factor: multigrid stood still");
  EXPECT_LT(report.linear_iterations, 1000);
}

TEST(LinearEquilibrium, IsThatOfFullGeometryAsTheLoadVanishes) {
  const MassSpringModel linear = linear_box("node_averaged"), full = full_box("node_averaged");
  const auto difference = [&](double gravity) {
    const Forces forces = hanging(linear, gravity);
    return (solve(linear, forces) - solve(full, forces, 1e-12)).norm();
  };
  EXPECT_NEAR(difference(0.8) / difference(0.4), 4, 0.1);
}

TEST(LinearEquilibrium, ThatDivergesLeavesTheBodyWhereItWas) {
  const MassSpringModel model = linear_box("node_averaged");
  Forces forces = hanging(model);
  forces.load(1, forces.load.cols() - 1) = std::numeric_limits<double>::infinity();
  QuasiStaticSolver solver(model, forces);
  State state = initial_state(model);
  EXPECT_EQ(solver.solve(1, state).status, Status::Diverged);
  EXPECT_EQ(state.x, model.network.X);
}

TEST(LinearEquilibrium, HoldsFloppyMotionsAndCountsThem) {
  MassSpringModel model = small_model();
  model.springs->stiffness.tail(4) << 50, 0, 0, 0;  // one spring is left to the inner node
  linearise(model);
  Forces forces = no_forces(model);
  const Eigen::Vector3d n = (model.network.X.col(4) - model.network.X.col(0)).normalized();
  const Eigen::Vector3d across = n.unitOrthogonal();
  for (int i = 0; i < 4; ++i)
    forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  forces.load.col(4) = 4 * n + 3 * across;
  EXPECT_EQ(QuasiStaticSolver(model, forces).n_floppy_motions(), 2);
  const Matrix3Xd u = solve(model, forces);
  EXPECT_LT((u.col(4) - 4. / 50 * n).norm(), kClose);
}

}  // namespace
}  // namespace testbed::massspring
