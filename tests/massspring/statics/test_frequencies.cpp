#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "massspring/calibrations/calibrate.h"
#include "massspring/statics/frequencies.h"
#include "massspring/time/integrators.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::MatrixXd;

constexpr double kSolverTolerance = 1e-7;

MassSpringModel bar() {
  const TetMesh mesh = box_tets(2, 3, 5, 0.1, 0.1);
  return calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface}, {},
                   find_calibration("node_averaged"));
}

/// Frequencies (Hz) of the pencil K, M by a dense solver.
Eigen::VectorXd frequencies_of(const MatrixXd& K, const MatrixXd& M) {
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> eigen(K, M);
  return eigen.eigenvalues().cwiseMax(0).cwiseSqrt() / (2 * M_PI);
}

void expect_those_of(const MassSpringModel& model, const MatrixXd& M) {
  constexpr int n = 12, kRigid = 6;
  const Eigen::VectorXd expected = frequencies_of(dense_stiffness(model), M).head(n),
                        found = natural_frequencies(model, {}, n);
  EXPECT_EQ(found.head(kRigid), Eigen::VectorXd::Zero(kRigid));
  EXPECT_LT((found - expected).tail(n - kRigid).norm(), kSolverTolerance * expected(n - 1));
}

TEST(NaturalFrequencies, AreThoseOfADenseSolver) {
  const MassSpringModel model = bar();
  expect_those_of(model, model.mass.replicate(1, 3).transpose().reshaped().asDiagonal());
}

TEST(NaturalFrequencies, OfSpreadMassAreThoseOfTheConsistentMatrix) {
  MassSpringModel model = bar();
  model.spread_mass = spread_mass(model.network.X, model.network.T, model.material.rho);
  expect_those_of(model, consistent_mass(model));
}

TEST(NaturalFrequencies, DampingOfARatioLetsTheLowestVibrationDieByIt) {
  const MassSpringModel model = bar();
  constexpr double kRatio = 0.1, kAmplitude = 1e-6;
  constexpr int kRigid = 6, kSteps = 400;
  const MatrixXd M = model.mass.replicate(1, 3).transpose().reshaped().asDiagonal();
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> eigen(dense_stiffness(model), M);
  const Eigen::VectorXd mode = eigen.eigenvectors().col(kRigid);
  const double omega = std::sqrt(eigen.eigenvalues()(kRigid)),
               damped = omega * std::sqrt(1 - kRatio * kRatio);
  Forces forces = no_forces(model);
  forces.mass_damping = damping_of_ratio(model, {}, kRatio);
  State state = initial_state(model);
  state.x += kAmplitude * mode.reshaped(3, state.x.cols());
  TimeStepper stepper(model, forces, "rk4", 1);
  for (int i = 0; i < kSteps; ++i) stepper.step(state, 2 * M_PI / damped / kSteps);
  const double left = (M * (state.x - model.network.X).reshaped()).dot(mode) / kAmplitude;
  EXPECT_NEAR(left / std::exp(-kRatio * omega * 2 * M_PI / damped), 1, 1e-4);
}

TEST(NaturalFrequencies, OfAnOscillatorWhoseOtherDirectionsAreHeld) {
  constexpr double kMass = 2, omega = 3;
  MassSpringModel model;
  model.network.X.setZero(3, 2);
  model.network.X(0, 1) = 1;
  model.mass = Eigen::Vector2d(1, kMass);
  model.springs = Springs{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, kMass * omega * omega)};
  const Eigen::Vector3d rest = Eigen::Vector3d::Zero();
  const Eigen::Matrix3d along = Eigen::Vector3d::UnitX() * Eigen::RowVector3d::UnitX();
  const Eigen::VectorXd found =
      natural_frequencies(model, {{0, Eigen::Matrix3d::Zero(), rest}, {1, along, rest}}, 1);
  EXPECT_NEAR(found(0), omega / (2 * M_PI), kSolverTolerance);
}

}  // namespace
}  // namespace testbed::massspring
