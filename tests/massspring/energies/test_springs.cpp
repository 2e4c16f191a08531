#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>

#include "massspring/energies/springs.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kDifferenceStep = 1e-5;  // central differences: error about 1e-10 of the third derivative
constexpr double kDifferenceTolerance = 1e-6;
constexpr double kRounding = 1e-12;

class EverySpringLaw : public testing::TestWithParam<SpringLaw> {
 protected:
  EverySpringLaw() { springs.law = GetParam(); }

  Matrix3Xd forces(const Matrix3Xd& x) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, x.cols());
    add_forces(springs, rest, x, f);
    return f;
  }
  Eigen::MatrixXd hessian(const Matrix3Xd& x, Curvature curvature = Curvature::Projected) const {
    BlockMatrix K = make_block_matrix(5, model.springs->E);
    add_blocks(springs, massspring::hessian(springs, rest, x, 1, curvature), K);
    mirror(K);
    return dense(K);
  }

  void expect_force_gradient(const Eigen::MatrixXd& K, const Matrix3Xd& x) const {
    ASSERT_GT(K.norm(), 1);
    for (int k = 0; k < x.size(); ++k) {
      Matrix3Xd up = x, down = x;
      up(k) += kDifferenceStep;
      down(k) -= kDifferenceStep;
      const Matrix3Xd column = (forces(up) - forces(down)) / (2 * kDifferenceStep);
      EXPECT_LT((K.col(k) + column.reshaped()).norm(), kDifferenceTolerance * K.norm());
    }
  }

  MassSpringModel model = small_model();
  Springs springs = *model.springs;
  Eigen::VectorXd rest = initial_state(model).rest_length;
  Matrix3Xd crushed = 0.6 * model.network.X + random_points(5, 0.2, 3);
  Matrix3Xd stretched = 1.7 * model.network.X + random_points(5, 0.1, 4);
};
INSTANTIATE_TEST_SUITE_P(Springs, EverySpringLaw, testing::Values(SpringLaw::Hooke, SpringLaw::Definite),
                         [](const auto& info) {
                           return info.param == SpringLaw::Hooke ? "hooke" : "definite";
                         });

TEST_P(EverySpringLaw, ForceIsMinusEnergyGradient) {
  for (const Matrix3Xd& x : {crushed, stretched}) {
    const Matrix3Xd f = forces(x);
    ASSERT_GT(f.norm(), 1);
    for (int k = 0; k < x.size(); ++k) {
      Matrix3Xd up = x, down = x;
      up(k) += kDifferenceStep;
      down(k) -= kDifferenceStep;
      const double slope = (energy(springs, rest, up) - energy(springs, rest, down)) / (2 * kDifferenceStep);
      EXPECT_NEAR(f(k), -slope, kDifferenceTolerance * f.norm());
    }
  }
}

TEST_P(EverySpringLaw, HessianIsMinusForceGradientUnderTension) {
  expect_force_gradient(hessian(stretched), stretched);
}

TEST_P(EverySpringLaw, ExactHessianIsMinusForceGradientAlsoUnderCompression) {
  expect_force_gradient(hessian(crushed, Curvature::Exact), crushed);
}

TEST_P(EverySpringLaw, BlocksApplyAsTheMatrixTheyForm) {
  const Matrix3Xd p = random_points(5, 1, 5);
  constexpr double kScale = 2.5;
  const SpringBlocks B = massspring::hessian(springs, rest, crushed, kScale);
  Matrix3Xd y = Matrix3Xd::Zero(3, 5);
  add_product(springs, B, p, y);
  const Eigen::VectorXd expected = kScale * hessian(crushed) * p.reshaped();
  ASSERT_GT(expected.norm(), 1);
  EXPECT_LT((y.reshaped() - expected).norm(), kRounding * expected.norm());
  std::vector<Eigen::Matrix3d> diagonal(5, Eigen::Matrix3d::Zero());
  add_diagonal(springs, B, diagonal);
  for (int i = 0; i < 5; ++i)
    EXPECT_LT((diagonal[i] - kScale * hessian(crushed).block<3, 3>(3 * i, 3 * i)).norm(),
              kRounding * diagonal[i].norm());
}

TEST_P(EverySpringLaw, HessianStaysSemidefiniteUnderCompression) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(hessian(crushed));
  EXPECT_GT(eigen.eigenvalues().minCoeff(), -kRounding * eigen.eigenvalues().maxCoeff());
  EXPECT_GT(eigen.eigenvalues().maxCoeff(), 1);
}

TEST_P(EverySpringLaw, LinearAndAngularMomentumAreKept) {
  const Matrix3Xd f = forces(crushed);
  Eigen::Vector3d torque = Eigen::Vector3d::Zero();
  for (int i = 0; i < 5; ++i) torque += crushed.col(i).cross(f.col(i));
  ASSERT_GT(f.norm(), 1);
  EXPECT_LT(f.rowwise().sum().norm(), kRounding * f.norm());
  EXPECT_LT(torque.norm(), kRounding * f.norm());
}

TEST_P(EverySpringLaw, ASpringOfNoLengthExertsNoForce) {
  Matrix3Xd x = model.network.X;
  x.col(1) = x.col(0);
  const Matrix3Xd f = forces(x);
  const Eigen::MatrixXd K = hessian(x);
  ASSERT_EQ(springs.E.col(0), Eigen::Vector2i(0, 1));
  springs = Springs{springs.E.rightCols(9).eval(), springs.stiffness.tail(9).eval(), 0, GetParam()};
  rest = rest.tail(9).eval();
  ASSERT_GT(f.norm(), 1);
  EXPECT_LT((forces(x) - f).norm(), kRounding * f.norm()) << "not those of the other springs";
  EXPECT_LT((hessian(x) - K).norm(), kRounding * K.norm());
}

TEST(Springs, DefiniteLawHasTheStiffnessOfHookesAtRest) {
  Springs one{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, 7), 0, SpringLaw::Definite};
  const Eigen::VectorXd rest = Eigen::VectorXd::Constant(1, 2);
  Matrix3Xd x = Matrix3Xd::Zero(3, 2), f = Matrix3Xd::Zero(3, 2);
  x(0, 1) = 2 - kDifferenceStep;
  add_forces(one, rest, x, f);
  EXPECT_NEAR(f(0, 1) / kDifferenceStep, 7, 1e-3);  // the law's next term is 2.5 difference_step / rest
  x(0, 1) = 1;                                      // k l0/4 (1 - 2^4)
  f.setZero();
  add_forces(one, rest, x, f);
  EXPECT_NEAR(f(0, 1), 7 * 2 / 4. * 15, kRounding * 100);
}

// Its energy is the work from rest, the integral of k l0/4 (1 - (l0/l)^4): not merely what has that slope.
TEST(Springs, DefiniteLawHasNoEnergyAtRestAndNoneOfItIsAddedThere) {
  Springs one{Eigen::Vector2i(0, 1), Eigen::VectorXd::Constant(1, 7), 0, SpringLaw::Definite};
  const Eigen::VectorXd rest = Eigen::VectorXd::Constant(1, 2);
  const auto energy_at = [&](double length) {
    Matrix3Xd x = Matrix3Xd::Zero(3, 2);
    x(0, 1) = length;
    return energy(one, rest, x);
  };
  EXPECT_EQ(energy_at(2), 0);
  EXPECT_NEAR(energy_at(2 - 1e-9), 0, kRounding);
  EXPECT_NEAR(energy_at(1), 7 * 2 / 4. * (1 - 2 + (2 * 2 * 2 - 1) * 2 / 3.), kRounding);
  EXPECT_NEAR(energy_at(3), 7 / 2., kRounding);
}

TEST(Springs, DampingMatrixIsMinusForceGradientByVelocityAndItsPowerIsLost) {
  MassSpringModel model = small_model();
  Springs springs = *model.springs;
  springs.damping = 3;
  const Matrix3Xd x = 1.1 * model.network.X, v = random_points(5, 1, 9);
  Matrix3Xd f = Matrix3Xd::Zero(3, 5);
  add_damping_forces(springs, x, v, f);
  ASSERT_GT(f.norm(), 0.1);
  BlockMatrix D = make_block_matrix(5, model.springs->E);
  constexpr double kScale = 2.5;
  add_blocks(springs, damping_matrix(springs, x, kScale), D);
  mirror(D);
  EXPECT_LT((dense(D) * v.reshaped() + kScale * f.reshaped()).norm(), kRounding * kScale * f.norm());
  EXPECT_NEAR(damping_power(springs, x, v), -f.cwiseProduct(v).sum(), kRounding * 100);
}

}  // namespace
}  // namespace testbed::massspring
