#include <gtest/gtest.h>

#include "massspring/quasi_static.h"

namespace testbed {
namespace {

constexpr double kStiffness = 100;   // N/m
constexpr double kTolerance = 1e-6;  // the solver's balance of forces is 1e-8 of the load

/// Springs of equal stiffness between the nodes, each of 1 kg.
MassSpringModel springs_between(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E) {
  MassSpringModel model;
  model.network = {X, Eigen::Matrix3Xi(3, 0), E, Eigen::Matrix4Xi(4, 0), static_cast<int>(X.cols())};
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

TEST(QuasiStatic, SpringCarriesTheLoadAlongItAndFloppyMotionsAreHeld) {
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
  }
}

}  // namespace
}  // namespace testbed
