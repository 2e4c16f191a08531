#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <stdexcept>

#include "massspring/energies/tractions.h"
#include "massspring/statics/exact_fields.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kRounding = 1e-12;
constexpr double kDifferenceStep = 1e-3;  // the fields are quadratic: central differences are exact but for
constexpr double kDifferenceTolerance = 1e-10;  // rounding
const Lame kLame{3, 2};
const Vector3d kCentre(0.1, 0.2, 0.3), kSomewhere(0.7, -0.4, 0.9);

class EveryField : public testing::TestWithParam<std::string> {
 protected:
  ExactField field = exact_field(GetParam(), kLame, kCentre);
};
INSTANTIATE_TEST_SUITE_P(ExactField, EveryField, testing::ValuesIn(exact_field_names()),
                         [](const auto& info) { return info.param; });

TEST_P(EveryField, StressFollowsFromDisplacementByHookesLaw) {
  Matrix3d G;
  for (int j = 0; j < 3; ++j) {
    const Vector3d h = kDifferenceStep * Vector3d::Unit(j);
    G.col(j) =
        (field.displacement(kSomewhere + h) - field.displacement(kSomewhere - h)) / (2 * kDifferenceStep);
  }
  const Matrix3d sigma = kLame.lambda * G.trace() * Matrix3d::Identity() + kLame.mu * (G + G.transpose());
  ASSERT_GT(sigma.norm(), 0.1);
  EXPECT_LT((field.stress(kSomewhere) - sigma).norm(), kDifferenceTolerance);
}

TEST_P(EveryField, StressIsInEquilibriumWithoutBodyForce) {
  Vector3d divergence = Vector3d::Zero();
  for (int j = 0; j < 3; ++j) {
    const Vector3d h = kDifferenceStep * Vector3d::Unit(j);
    divergence +=
        (field.stress(kSomewhere + h) - field.stress(kSomewhere - h)).col(j) / (2 * kDifferenceStep);
  }
  EXPECT_LT(divergence.norm(), kDifferenceTolerance);
}

TEST_P(EveryField, TractionsOfAClosedBodyBalance) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.2);
  const Matrix3Xd f = traction_forces(field.stress, mesh.X, mesh.F);
  ASSERT_GT(f.norm(), 0.1);
  Vector3d torque = Vector3d::Zero();
  for (Eigen::Index i = 0; i < f.cols(); ++i) torque += mesh.X.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), kRounding * f.norm());
  EXPECT_LT(torque.norm(), kRounding * f.norm());
}

class LinearField : public EveryField {};
INSTANTIATE_TEST_SUITE_P(ExactField, LinearField, testing::Values("pressure", "uniaxial", "shear"),
                         [](const auto& info) { return info.param; });

TEST_P(LinearField, WorkOfTractionsIsTwiceTheStrainEnergy) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.2);
  Matrix3d G;
  for (int j = 0; j < 3; ++j)
    G.col(j) = field.displacement(kCentre + Vector3d::Unit(j)) - field.displacement(kCentre);
  const double work =
      traction_forces(field.stress, mesh.X, mesh.F).cwiseProduct(displacements(field, mesh.X)).sum();
  const double V = lumped_mass(mesh.X, mesh.T, 1).sum();
  EXPECT_NEAR(work, V * field.stress(kCentre).cwiseProduct(G).sum(), kRounding * V * 100);
}

// Integrals of x^3 times 1 - x - y, x and y over the unit triangle.
TEST(TractionForces, AreExactForCubicStress) {
  Matrix3Xd X(3, 3);
  X << 0, 1, 0, 0, 0, 1, 0, 0, 0;
  const Matrix3Xd f = traction_forces(
      [](const Vector3d& x) -> Matrix3d {
        return std::pow(x(0), 3) * Vector3d(0, 0, 1) * Vector3d(0, 0, 1).transpose();
      },
      X, Eigen::Vector3i(0, 1, 2));
  EXPECT_LT((f.row(2) - Eigen::RowVector3d(1. / 120, 1. / 30, 1. / 120)).norm(), kRounding);
  EXPECT_EQ(f.topRows<2>().norm(), 0);
}

TEST(ExactField, RefusesAnUnknownName) {
  EXPECT_THROW(exact_field("bend", kLame, kCentre), std::runtime_error);
}

TEST(SurfaceError, IgnoresSmallRigidMotionAndSeesTheRest) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.2);
  const Matrix3Xd exact = displacements(exact_field("bending", kLame, kCentre), mesh.X);
  Matrix3Xd moved = exact;
  for (Eigen::Index i = 0; i < moved.cols(); ++i)
    moved.col(i) += Vector3d(1, 2, 3) + Vector3d(3, 2, 1).cross(mesh.X.col(i));
  EXPECT_LT(surface_error(moved, exact, mesh.X, mesh.F).l2, kRounding * 100);
  EXPECT_NEAR(surface_error(1.1 * exact, exact, mesh.X, mesh.F).l2, 0.1, kRounding);
  EXPECT_NEAR(surface_error(1.1 * exact, exact, mesh.X, mesh.F).largest, 0.1, kRounding);
}

/// What is left of u when the columns of rigid motions are fitted to it by weighted least squares.
Matrix3Xd without_fitted_motion(const Matrix3Xd& u, const Matrix3Xd& X, const Eigen::VectorXd& weights) {
  Eigen::MatrixXd motions(u.size(), 6);
  for (Eigen::Index i = 0; i < X.cols(); ++i)
    for (int k = 0; k < 3; ++k) {
      motions.block<3, 1>(3 * i, k) = Vector3d::Unit(k);
      motions.block<3, 1>(3 * i, 3 + k) = Vector3d::Unit(k).cross(X.col(i));
    }
  const Eigen::VectorXd roots = weights.cwiseSqrt().transpose().replicate(3, 1).reshaped();
  const Eigen::VectorXd best =
      (roots.asDiagonal() * motions).colPivHouseholderQr().solve(roots.asDiagonal() * u.reshaped());
  return (u.reshaped() - motions * best).reshaped(3, u.cols());
}

class Errors : public testing::Test {
 protected:
  // A box that is coarser at one side: weights by area and equal ones differ.
  const TetMesh mesh = [] {
    TetMesh result = box_tets(3, 2, 2, 0.5, 0.2);
    for (double& z : result.X.row(2)) z += z * z;
    return result;
  }();
  const Matrix3Xd exact = displacements(exact_field("bending", kLame, kCentre), mesh.X);
  const Matrix3Xd u = displacements(exact_field("cubic_harmonic", kLame, 2 * kCentre), mesh.X);
};

TEST_F(Errors, OfTheSurfaceAreWeightedByAreaAfterTheBestRigidMotion) {
  const Eigen::Index n = mesh.F.maxCoeff() + 1;
  Eigen::VectorXd areas = Eigen::VectorXd::Zero(n);
  for (const auto& t : mesh.F.colwise())
    for (int i : t)
      areas(i) += (mesh.X.col(t[1]) - mesh.X.col(t[0])).cross(mesh.X.col(t[2]) - mesh.X.col(t[0])).norm() / 6;
  const Matrix3Xd X = mesh.X.leftCols(n),
                  difference = without_fitted_motion((u - exact).leftCols(n), X, areas),
                  reference = without_fitted_motion(exact.leftCols(n), X, areas);
  const SurfaceError found = surface_error(u, exact, mesh.X, mesh.F);
  EXPECT_NEAR(
      found.l2,
      std::sqrt(difference.colwise().squaredNorm().dot(areas) / reference.colwise().squaredNorm().dot(areas)),
      kRounding * 100);
  EXPECT_NEAR(found.largest, difference.colwise().norm().maxCoeff() / reference.colwise().norm().maxCoeff(),
              kRounding * 100);
}

TEST_F(Errors, OfNodesWeighThemEquallyAndAreOfTheLargestDisplacement) {
  const Eigen::VectorXd equal = Eigen::VectorXd::Ones(mesh.X.cols());
  const Eigen::RowVectorXd expected = without_fitted_motion(u - exact, mesh.X, equal).colwise().norm() /
                                      without_fitted_motion(exact, mesh.X, equal).colwise().norm().maxCoeff();
  ASSERT_GT(expected.maxCoeff(), 0.1);
  EXPECT_LT((node_errors(u, exact, mesh.X).transpose() - expected).norm(), kRounding * 100);
}

}  // namespace
}  // namespace testbed::massspring
