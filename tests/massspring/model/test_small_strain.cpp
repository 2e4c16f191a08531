#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "tests/massspring/dense.h"
#include "tests/massspring/linear_box.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

/// Coupled springs and independent ones.
MassSpringModel mixed() {
  MassSpringModel model = full_box("node_averaged", 1, 1e3, 0.4);
  model.springs = full_box("van_gelder", 1, 1e3).springs;
  return model;
}

/// Moved by `size` at random from rest, its rest lengths and shapes shrunk likewise.
State disturbed(const MassSpringModel& model, double size) {
  State state = initial_state(model);
  state.x += random_points(static_cast<int>(state.x.cols()), size, 5);
  Random random(3);
  for (double& r : state.rest_length) r *= 1 - size * random.uniform();
  state.patch_scale = Eigen::VectorXd::Ones(model.tet_springs->n_patches());
  for (double& s : state.patch_scale) s -= size * random.uniform();
  return state;
}

TEST(SmallStrain, ForcesAndEnergyDifferFromFullGeometryByTheNextOrder) {
  const MassSpringModel full = mixed();
  MassSpringModel linear = full;
  linearise(linear);
  const auto difference = [&](double size) {
    const State state = disturbed(full, size);
    return Eigen::Vector2d((elastic_forces(linear, state) - elastic_forces(full, state)).norm(),
                           std::abs(elastic_energy(linear, state) - elastic_energy(full, state)));
  };
  const Eigen::Vector2d one = difference(1e-4), half = difference(0.5e-4);
  EXPECT_NEAR(one[0] / half[0], 4, 0.05);
  EXPECT_NEAR(one[1] / half[1], 8, 0.1);
}

TEST(SmallStrain, ForcesAreTheNegativeGradientOfTheEnergyAtAnySize) {
  MassSpringModel model = mixed();
  linearise(model);
  const State state = disturbed(model, 0.1);
  const Matrix3Xd d = random_points(static_cast<int>(state.x.cols()), 1, 8);
  State ahead = state, behind = state;
  ahead.x += d;
  behind.x -= d;
  const double slope = (elastic_energy(model, ahead) - elastic_energy(model, behind)) / 2;
  EXPECT_NEAR(slope, -elastic_forces(model, state).cwiseProduct(d).sum(), 1e-10 * std::abs(slope));
}

TEST(SmallStrain, RowSumsBoundThoseOfTheStiffnessFromNear) {
  for (const char* calibration : {"van_gelder", "edge_coupled", "node_averaged"}) {
    const MassSpringModel model = linear_box(calibration);
    const Eigen::MatrixXd K = dense_stiffness(model);
    const Eigen::VectorXd bounds = row_sums(model);
    for (Eigen::Index i = 0; i < bounds.size(); ++i) {
      double sum = 0;
      for (Eigen::Index j = 0; j < bounds.size(); ++j) sum += K.block<3, 3>(3 * i, 3 * j).operatorNorm();
      EXPECT_GE(bounds[i], sum * (1 - 1e-12)) << calibration;
      EXPECT_LE(bounds[i], 10 * sum) << calibration;
    }
  }
}

TEST(SmallStrain, StiffnessOfIndependentSpringsIsTheSumOfTheirDirections) {
  MassSpringModel model = small_model();
  model.springs->law = SpringLaw::Definite;
  linearise(model);
  Eigen::MatrixXd K = Eigen::MatrixXd::Zero(15, 15);
  for (int s = 0; s < 10; ++s) {
    const Eigen::Vector2i e = model.springs->E.col(s);
    const Eigen::Vector3d n = (model.network.X.col(e[0]) - model.network.X.col(e[1])).normalized();
    Eigen::VectorXd stretch = Eigen::VectorXd::Zero(15);
    stretch.segment<3>(3 * e[0]) = n;
    stretch.segment<3>(3 * e[1]) = -n;
    K += model.springs->stiffness(s) * stretch * stretch.transpose();
  }
  State state = initial_state(model);
  state.x += random_points(5, 10, 2);  // far beyond what any law of springs bears
  const Eigen::VectorXd f = -K * (state.x - model.network.X).reshaped();
  EXPECT_LT((elastic_forces(model, state).reshaped() - f).norm(), 1e-12 * f.norm());
  EXPECT_LT((dense_stiffness(model) - K).norm(), 1e-12 * K.norm());
}

TEST(SmallStrain, StrainIsTheLargestPrincipalValueOfTheSymmetricGradient) {
  const MassSpringModel model = full_box("van_gelder", 1);
  const Matrix3Xd& X = model.network.X;
  const Eigen::Matrix3d R = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  const Eigen::Matrix3d strain = R * Eigen::Vector3d(0.1, -0.3, 0.2).asDiagonal() * R.transpose();
  Eigen::Matrix3d turn;
  turn << 0, -2, 1, 2, 0, 3, -1, -3, 0;
  EXPECT_NEAR(largest_linear_strain(X, model.network.T, (strain + turn) * X), 0.3, 1e-12);
  EXPECT_NEAR(largest_mean_strain(X, model.network.T, (strain + turn) * X), 0.3, 1e-12);
  double largest = 0;
  for (const auto& e : model.springs->E.colwise()) {
    const Eigen::Vector3d n = (X.col(e[0]) - X.col(e[1])).normalized();
    largest = std::max(largest, std::abs(n.dot(strain * n)));
  }
  EXPECT_NEAR(largest_linear_strain(X, model.springs->E, (strain + turn) * X), largest, 1e-12);
}

TEST(SmallStrain, MeansAtNodesAreByVolumeAndTakeFlatTetrahedra) {
  const MassSpringModel model = full_box("van_gelder", 1);
  const Matrix3Xd &X = model.network.X, u = 0.1 * Matrix3Xd::Random(3, X.cols());
  const Eigen::Matrix4Xi& T = model.network.T;
  double expected = 0;
  for (int i = 0; i < X.cols(); ++i) {
    double volume = 0;
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    for (const auto& t : T.colwise()) {
      if ((t.array() != i).all()) continue;
      const Eigen::Matrix3d rest = X(Eigen::all, t.tail<3>()).colwise() - X.col(t[0]);
      const Eigen::Matrix3d gradient = (u(Eigen::all, t.tail<3>()).colwise() - u.col(t[0])) * rest.inverse();
      volume += rest.determinant();
      sum += rest.determinant() * (gradient + gradient.transpose()) / 2;
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(sum / volume);
    expected = std::max(expected, eigen.eigenvalues().cwiseAbs().maxCoeff());
  }
  EXPECT_NEAR(largest_mean_strain(X, T, u), expected, 1e-12 * expected);

  Eigen::Matrix4Xi with_flat(4, T.cols() + 1);
  with_flat << T, T.col(0)(Eigen::Vector4i(0, 1, 2, 2));
  const Eigen::DiagonalMatrix<double, 3> strain(0.1, -0.3, 0.2);
  EXPECT_NEAR(largest_mean_strain(X, with_flat, strain * X), 0.3, 1e-12);
}

}  // namespace
}  // namespace testbed::massspring
