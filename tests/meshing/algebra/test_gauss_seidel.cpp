#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/QR>

#include "meshing/algebra/gauss_seidel.h"
#include "meshing/base/random.h"

namespace testbed::meshing {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Couples node i to i + 1 and i + 5.
BlockMatrix random_matrix(int n) {
  Random random(1);
  std::vector<int> ends;
  for (int i = 0; i < n; ++i)
    for (const int step : {1, 5})
      if (i + step < n) ends.insert(ends.end(), {i, i + step});
  BlockMatrix A = make_block_matrix(
      n, Eigen::Map<Eigen::Matrix2Xi>(ends.data(), 2, static_cast<Eigen::Index>(ends.size()) / 2));
  for (Eigen::Matrix3d& block : A.block)
    for (double& b : block.reshaped()) b = random.uniform() - 0.5;
  symmetrise(A, A.block.data()->data());
  for (const int i : A.diagonal) {
    A.block[i] = (A.block[i] + A.block[i].transpose()).eval();
    A.block[i].diagonal().array() += 6;
  }
  return A;
}

MatrixXd dense(const BlockMatrix& A) {
  MatrixXd D = MatrixXd::Zero(3 * A.rows(), 3 * A.rows());
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      D.block<3, 3>(3 * i, 3 * A.column[k]) = A.block[k];
  return D;
}

VectorXd flat(const PaddedField& u, int n) {
  return u.topLeftCorner(3, n).cast<double>().reshaped();
}

TEST(GaussSeidel, SweepsAreTriangularSolves) {
  constexpr int n = 23;
  constexpr double kSingle = 2e-6;
  const BlockMatrix A = random_matrix(n);
  const MatrixXd D = dense(A);
  MatrixXd lower = D;  // with the whole blocks of the diagonal
  for (int i = 0; i < n; ++i) lower.block(3 * i, 3 * i + 3, 3, 3 * (n - i - 1)).setZero();
  PaddedField r, z, d;
  pad(Eigen::Matrix3Xd(VectorXd::LinSpaced(3 * n, -1, 1).array().sin().matrix().reshaped(3, n)), 1, r);
  const VectorXd b = flat(r, n);
  std::vector<int> first_row(16, n);
  first_row[0] = 0;
  const std::vector<float> blocks = single_precision(A);
  const GaussSeidel sweeps(A, blocks, first_row);

  sweeps.sweep_down(r, z);
  const VectorXd down = lower.lu().solve(b);
  EXPECT_LT((flat(z, n) - down).norm(), kSingle * down.norm());
  sweeps.residual_of_sweep(z, d);
  EXPECT_LT((flat(d, n) - (b - D * down)).norm(), kSingle * b.norm());
  sweeps.sweep_up(r, z);
  const VectorXd up = down + lower.transpose().lu().solve(b - D * down);
  EXPECT_LT((flat(z, n) - up).norm(), kSingle * up.norm());
  EXPECT_EQ(z.row(3).norm() + z.rightCols(1).norm(), 0);
}

TEST(BlockMatrix, SumsWhatBelongsToAPairAndHoldsUnknowns) {
  constexpr int n = 9;
  BlockMatrix A = random_matrix(n);
  const MatrixXd whole = dense(A);
  for (int i = 0; i < n; ++i)  // parts of each pair on both sides
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      if (A.column[k] != i) A.block[k] *= A.column[k] > i ? 0.25 : 0.75;
  symmetrise(A, A.block.data()->data());
  EXPECT_LT((dense(A) - whole).norm(), 1e-14 * whole.norm());

  std::vector<char> is_constrained(3 * n);
  for (const int k : {0, 1, 2, 10, 26}) is_constrained[k] = true;
  hold(A, is_constrained, A.block.data()->data());
  MatrixXd expected = whole;
  for (int k = 0; k < 3 * n; ++k)
    if (is_constrained[k]) {
      const double diagonal = whole(k, k);
      expected.row(k).setZero();
      expected.col(k).setZero();
      expected(k, k) = diagonal;
    }
  EXPECT_LT((dense(A) - expected).norm(), 1e-14 * whole.norm());
}

}  // namespace
}  // namespace testbed::meshing
