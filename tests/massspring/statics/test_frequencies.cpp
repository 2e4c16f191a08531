#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "massspring/calibrations/calibrate.h"
#include "massspring/statics/frequencies.h"
#include "massspring/time/integrators.h"
#include "meshing/surface_energies/handles.h"
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
  const Eigen::VectorXd expected = frequencies_of(dense_stiffness(model), M).segment(kRigid, n);
  const NaturalFrequencies found = natural_frequencies(model, no_forces(model), n);
  EXPECT_EQ(found.n_zero, kRigid);
  EXPECT_LT((found.frequency - expected).norm(), kSolverTolerance * expected(n - 1));
}

TEST(NaturalFrequencies, AreThoseOfADenseSolver) {
  const MassSpringModel model = bar();
  expect_those_of(model, model.mass.replicate(1, 3).transpose().reshaped().asDiagonal());
}

TEST(NaturalFrequencies, OfConsistentMassAreThoseOfTheConsistentMatrix) {
  MassSpringModel model = bar();
  model.consistent_mass = consistent_mass(model.network.X, model.network.T, model.material.rho);
  expect_those_of(model, consistent_mass(model));
}

TEST(NaturalFrequencies, OfABodyThatIsHeldAndWhoseVolumeIsStiffAreThoseOfAllItsForces) {
  constexpr int n = 6;
  constexpr double P = 1e5;
  const MassSpringModel model = bar();
  Forces forces = no_forces(model);
  add_volume_penalty(P, model, forces);
  meshing::SurfaceProblem problem;
  problem.held.push_back({{0, 3, 7}, {}});
  problem.held[0].handle.stiffness = 3e4;
  for (auto& handle : meshing::handles_of(problem, model.network.X))
    forces.surface.push_back(std::move(handle));
  // Forces of what acts on the surface, by central differences.
  constexpr double h = 1e-6;
  const Eigen::Matrix3Xd& X = model.network.X;
  MatrixXd K = dense_stiffness(model);
  for (Eigen::Index k = 0; k < X.size(); ++k) {
    Eigen::Matrix3Xd change = Eigen::Matrix3Xd::Zero(3, X.cols());
    for (const double sign : {1., -1.}) {
      Eigen::Matrix3Xd x = X;
      x.reshaped()(k) += sign * h;
      for (const auto& energy : forces.surface) {
        Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, X.cols());
        energy->add_forces(x, f);
        change -= sign / (2 * h) * f;
      }
    }
    K.col(k) += change.reshaped();
  }
  const MatrixXd M = model.mass.replicate(1, 3).transpose().reshaped().asDiagonal();
  const NaturalFrequencies found = natural_frequencies(model, forces, n);
  EXPECT_EQ(found.n_zero, 0);
  const Eigen::VectorXd expected = frequencies_of((K + K.transpose()) / 2, M).head(n);
  EXPECT_LT((found.frequency - expected).norm(), 1e-6 * expected(n - 1));
  EXPECT_GT(expected(0), 0.01 * natural_frequencies(model, no_forces(model), 1).frequency(0));
}

TEST(NaturalFrequencies, FloppyMotionsOfAMechanismAreCounted) {
  // Springs along the edges of a box of cells: cells shear without energy.
  const TetMesh mesh = box_tets(2, 2, 2, 0.1, 0);
  MassSpringModel model;
  model.network.X = mesh.X;
  model.mass = Eigen::VectorXd::Ones(mesh.X.cols());
  std::vector<Eigen::Vector2i> edges;
  for (int i = 0; i < mesh.X.cols(); ++i)
    for (int j = 0; j < i; ++j)
      if (std::abs((mesh.X.col(i) - mesh.X.col(j)).norm() - 0.1) < 1e-9) edges.emplace_back(j, i);
  Eigen::Matrix2Xi E(2, static_cast<Eigen::Index>(edges.size()));
  for (size_t k = 0; k < edges.size(); ++k) E.col(static_cast<Eigen::Index>(k)) = edges[k];
  model.springs = Springs{E, Eigen::VectorXd::Ones(E.cols())};
  const Eigen::SelfAdjointEigenSolver<MatrixXd> dense(dense_stiffness(model));
  const auto n_zero = (dense.eigenvalues().array() < 1e-9).count();
  ASSERT_GT(n_zero, 18);
  const NaturalFrequencies found = natural_frequencies(model, no_forces(model), 4);
  EXPECT_EQ(found.n_zero, n_zero);
  const Eigen::VectorXd expected = dense.eigenvalues().segment(n_zero, 4).cwiseSqrt() / (2 * M_PI);
  EXPECT_LT((found.frequency - expected).norm(), kSolverTolerance * expected(3));
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
  forces.mass_damping = damping_of_ratio(model, forces, kRatio);
  State state = initial_state(model);
  state.x += kAmplitude * mode.reshaped(3, state.x.cols());
  TimeStepper stepper(model, forces, "rk4", 1);
  for (int i = 0; i < kSteps; ++i) stepper.step(state, 2 * M_PI / damped / kSteps);
  const double left = (M * (state.x - model.network.X).reshaped()).dot(mode) / kAmplitude;
  EXPECT_NEAR(left / std::exp(-kRatio * omega * 2 * M_PI / damped), 1, 1e-4);
}

TEST(NaturalFrequencies, OfAnOscillatorWhoseOtherDirectionsAreConstrained) {
  constexpr double kMass = 2, omega = 3;
  MassSpringModel model;
  model.network.X.setZero(3, 2);
  model.network.X(0, 1) = 1;
  model.mass = Eigen::Vector2d(1, kMass);
  model.springs = Springs{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, kMass * omega * omega)};
  const Eigen::Vector3d rest = Eigen::Vector3d::Zero();
  const Eigen::Matrix3d along = Eigen::Vector3d::UnitX() * Eigen::RowVector3d::UnitX();
  Forces forces = no_forces(model);
  forces.constraints = {{0, Eigen::Matrix3d::Zero(), rest}, {1, along, rest}};
  const auto [frequency, n_zero] = natural_frequencies(model, forces, 3);  // of which there is one
  ASSERT_EQ(frequency.size(), 1);
  EXPECT_NEAR(frequency(0), omega / (2 * M_PI), kSolverTolerance);
  EXPECT_EQ(n_zero, 0);
}

}  // namespace
}  // namespace testbed::massspring
