#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "massspring/calibrations/calibrate.h"
#include "massspring/time/integrators.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;

/// A bar of consistent mass.
MassSpringModel bar(double jitter = 0.1) {
  const TetMesh mesh = box_tets(2, 3, 5, 0.1, jitter);
  MassSpringModel model = calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface}, {},
                                    find_calibration("node_averaged"));
  model.consistent_mass = consistent_mass(mesh.X, mesh.T, model.material.rho);
  return model;
}

TEST(ConsistentMass, IsTheConsistentMatrix) {
  const MassSpringModel model = bar();
  const Matrix3Xd v = random_points(static_cast<int>(model.mass.size()), 1, 3);
  const Matrix3Xd expected = (consistent_mass(model) * v.reshaped()).reshaped(3, v.cols());
  EXPECT_LT((momenta(model, v) - expected).norm(), 1e-14 * expected.norm());
  EXPECT_GT((v * model.mass.asDiagonal() - expected).norm(), 0.1 * expected.norm());

  BlockMatrix M = stiffness_pattern(model);
  for (int i = 0; i < M.rows(); ++i) M.block[M.diagonal[i]].diagonal().array() += model.mass(i);
  add_blocks(*model.consistent_mass, -1, M);
  EXPECT_LT((dense(M) - consistent_mass(model)).norm(), 1e-14 * dense(M).norm());
}

TEST(ConsistentMass, TurnsWithTheInertiaOfTheSolid) {
  MassSpringModel model = bar(0);
  const Matrix3Xd& X = model.network.X;
  const Vector3d size = X.rowwise().maxCoeff() - X.rowwise().minCoeff(),
                 centre = X.rowwise().minCoeff() + size / 2;
  const double exact =
      model.material.rho * size.prod() * (size.head<2>().squaredNorm() / 12) / 2;  // a box, 1/s about z
  Matrix3Xd v(3, X.cols());
  for (Eigen::Index i = 0; i < X.cols(); ++i) v.col(i) = Vector3d::UnitZ().cross(X.col(i) - centre);
  EXPECT_NEAR(kinetic_energy(model, v) / exact, 1, 1e-12);
  model.consistent_mass.reset();
  EXPECT_GT(kinetic_energy(model, v) / exact, 1.1);
}

TEST(ConsistentMass, EveryImplicitSchemeSwingsByIt) {
  MassSpringModel model = bar();
  const Matrix3Xd& X = model.network.X;
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> eigen(dense_stiffness(model),
                                                                 consistent_mass(model));
  constexpr int kRigid = 6;
  const double omega = std::sqrt(eigen.eigenvalues()(kRigid)), amplitude = 1e-6;
  const Matrix3Xd mode = eigen.eigenvectors().col(kRigid).reshaped(3, X.cols());
  const Forces forces = no_forces(model);
  const auto phase_error = [&](const std::string& integrator, int n_steps) {
    TimeStepper stepper(model, forces, integrator, 1, {1e-12});
    State state = initial_state(model);
    state.x += amplitude * mode;
    for (int i = 0; i < n_steps; ++i)
      EXPECT_EQ(stepper.step(state, 2 * M_PI / omega / n_steps).status, Status::Ok);
    const double along = momenta(model, state.x - X).cwiseProduct(mode).sum(),
                 across = momenta(model, state.v).cwiseProduct(mode).sum() / omega;
    return std::abs(std::atan2(across, along));
  };
  // Second order: (2 pi)^3 / 12 / n^2 for the midpoint rule, four times that for BDF2; twice the first
  // order's square.
  constexpr double kImplicitError = 0.012;
  for (const char* integrator : {"midpoint", "tr_bdf2", "bdf2", "minimising_euler", "implicit_euler"})
    EXPECT_LT(phase_error(integrator, 100), kImplicitError) << integrator;
  model.consistent_mass.reset();
  EXPECT_GT(phase_error("midpoint", 100), 0.5);
}

TEST(ConsistentMass, GatheredAtConstrainedNodesLeavesTheOthersTheirWholeInertia) {
  MassSpringModel model = bar();
  const std::vector<int> constrained{0, 3, 7};
  Matrix3Xd v = Vector3d(1, 2, 3).replicate(1, model.mass.size());
  for (int i : constrained) v.col(i).setZero();
  const Matrix3Xd at_nodes = v * model.mass.asDiagonal();
  EXPECT_GT((momenta(model, v) - at_nodes).norm(), 0.01 * at_nodes.norm());
  lump(constrained, *model.consistent_mass);
  EXPECT_LT((momenta(model, v) - at_nodes).norm(), 1e-14 * at_nodes.norm());
}

TEST(ConsistentMass, ExplicitSchemesRefuseIt) {
  const MassSpringModel model = bar();
  const Forces forces = no_forces(model);
  EXPECT_THROW(TimeStepper(model, forces, "symplectic_euler", 1), std::runtime_error);
}

}  // namespace
}  // namespace testbed::massspring
