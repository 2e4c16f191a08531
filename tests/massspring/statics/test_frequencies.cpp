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

constexpr double solver_tolerance = 1e-7;

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
  constexpr int n = 12, n_rigid = 6;
  const Eigen::VectorXd expected = frequencies_of(dense_stiffness(model), M).head(n),
                        found = natural_frequencies(model, {}, n);
  EXPECT_EQ(found.head(n_rigid), Eigen::VectorXd::Zero(n_rigid));
  EXPECT_LT((found - expected).tail(n - n_rigid).norm(), solver_tolerance * expected(n - 1));
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
  constexpr double ratio = 0.1, amplitude = 1e-6;
  constexpr int n_rigid = 6, n_steps = 400;
  const MatrixXd M = model.mass.replicate(1, 3).transpose().reshaped().asDiagonal();
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> eigen(dense_stiffness(model), M);
  const Eigen::VectorXd mode = eigen.eigenvectors().col(n_rigid);
  const double omega = std::sqrt(eigen.eigenvalues()(n_rigid)), damped = omega * std::sqrt(1 - ratio * ratio);
  Forces forces = no_forces(model);
  forces.mass_damping = damping_of_ratio(model, {}, ratio);
  State state = initial_state(model);
  state.x += amplitude * mode.reshaped(3, state.x.cols());
  TimeStepper stepper(model, forces, "rk4", 1);
  for (int i = 0; i < n_steps; ++i) stepper.step(state, 2 * M_PI / damped / n_steps);
  const double left = (M * (state.x - model.network.X).reshaped()).dot(mode) / amplitude;
  EXPECT_NEAR(left / std::exp(-ratio * omega * 2 * M_PI / damped), 1, 1e-4);
}

TEST(NaturalFrequencies, OfAnOscillatorWhoseOtherDirectionsAreHeld) {
  constexpr double mass = 2, omega = 3;
  MassSpringModel model;
  model.network.X.setZero(3, 2);
  model.network.X(0, 1) = 1;
  model.mass = Eigen::Vector2d(1, mass);
  model.springs = Springs{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, mass * omega * omega)};
  const Eigen::Vector3d rest = Eigen::Vector3d::Zero();
  const Eigen::Matrix3d along = Eigen::Vector3d::UnitX() * Eigen::RowVector3d::UnitX();
  const Eigen::VectorXd found =
      natural_frequencies(model, {{0, Eigen::Matrix3d::Zero(), rest}, {1, along, rest}}, 1);
  EXPECT_NEAR(found(0), omega / (2 * M_PI), solver_tolerance);
}

}  // namespace
}  // namespace testbed::massspring
