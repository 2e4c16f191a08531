#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>

#include "meshing/algebra/lowest_modes.h"

namespace testbed::meshing {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// K = Q^-T diag(eigenvalue) Q^-1 and M = Q^-T Q^-1 for a regular Q, whose columns then are the modes.
struct Known {
  MatrixXd Q, K, M;

  explicit Known(const VectorXd& eigenvalue)
      : Q(Eigen::HouseholderQR<MatrixXd>(MatrixXd::Random(eigenvalue.size(), eigenvalue.size()))
              .householderQ()) {
    Q = VectorXd::LinSpaced(eigenvalue.size(), 1, 3).asDiagonal() * Q;
    const MatrixXd inverse = Q.inverse();
    K = inverse.transpose() * eigenvalue.asDiagonal() * inverse;
    M = inverse.transpose() * inverse;
  }

  LowestModes lowest(int n, double zero) const { return lowest_modes(pencil(zero), n); }

  Pencil pencil(double zero) const {
    const Eigen::LLT<MatrixXd> factor(K + 1e3 * zero * M);
    return {[this](const MatrixXd& x) -> MatrixXd { return K * x; },
            [this](const MatrixXd& x) -> MatrixXd { return M * x; },
            [factor](const MatrixXd& x) -> MatrixXd { return factor.solve(x); }, K.rows(), zero};
  }
};

constexpr double kZero = 1e-9, kTolerance = 1e-8;

TEST(LowestModes, RepeatedEigenvaluesAreFoundAsOftenAsTheyAre) {
  VectorXd eigenvalue = VectorXd::LinSpaced(80, 10, 500);
  eigenvalue.head(15) << 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 2, 3, 3, 3;
  const LowestModes found = Known(eigenvalue).lowest(9, kZero);
  EXPECT_EQ(found.n_zero, 6);
  ASSERT_EQ(found.eigenvalue.size(), 9);
  EXPECT_LT((found.eigenvalue - eigenvalue.segment(6, 9)).norm(), kTolerance);
}

TEST(LowestModes, ManyMotionsWithoutEnergyAreAllCounted) {
  for (int n_zero : {0, 1, 7, 20, 45}) {
    VectorXd eigenvalue = VectorXd::LinSpaced(120, 1, 120);
    eigenvalue.head(n_zero).setZero();
    const LowestModes found = Known(eigenvalue).lowest(3, kZero);
    EXPECT_EQ(found.n_zero, n_zero);
    EXPECT_LT((found.eigenvalue - eigenvalue.segment(n_zero, 3)).norm(), kTolerance) << n_zero;
  }
}

TEST(LowestModes, RootsStiffenThePencilAsTheirProductsDo) {
  VectorXd eigenvalue = VectorXd::LinSpaced(60, 1, 60);
  eigenvalue.head(3).setZero();
  const Known known(eigenvalue);
  const MatrixXd U = 5 * MatrixXd::Random(60, 2);
  const Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd> dense(known.K + U * U.transpose(), known.M);
  const LowestModes found = lowest_modes(with_roots(known.pencil(kZero), U), 6);
  EXPECT_EQ(found.n_zero, 1);
  EXPECT_LT((found.eigenvalue - dense.eigenvalues().segment(1, 6)).norm(), kTolerance);
}

TEST(LowestModes, OfASmallPencilAreAllThatThereAre) {
  const VectorXd eigenvalue = VectorXd::LinSpaced(5, 0, 4);
  const LowestModes found = Known(eigenvalue).lowest(12, kZero);
  EXPECT_EQ(found.n_zero, 1);
  ASSERT_EQ(found.eigenvalue.size(), 4);
  EXPECT_LT((found.eigenvalue - eigenvalue.tail(4)).norm(), kTolerance);
}

TEST(LowestModes, SatisfyTheirEquationAndAreOrthonormal) {
  const Known known(VectorXd::LinSpaced(60, 1, 60).array().square().matrix());
  const LowestModes found = known.lowest(5, kZero);
  const MatrixXd& V = found.shape;
  EXPECT_LT((V.transpose() * known.M * V - MatrixXd::Identity(5, 5)).norm(), 1e-10);
  const MatrixXd residual = known.K * V - known.M * V * found.eigenvalue.asDiagonal();
  EXPECT_LT(residual.norm(), 1e-5 * (known.K * V).norm());
}

}  // namespace
}  // namespace testbed::meshing
