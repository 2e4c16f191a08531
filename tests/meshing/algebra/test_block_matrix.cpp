#include <gtest/gtest.h>

#include "meshing/algebra/block_matrix.h"
#include "meshing/base/random.h"

namespace testbed::massspring {
namespace {

TEST(BlockMatrix, HoldsTheDiagonalAndEveryPairOnceInBothOrders) {
  Eigen::Matrix2Xi pairs(2, 4);
  pairs << 0, 2, 0, 3,  //
      2, 0, 3, 0;
  const BlockMatrix A = make_block_matrix(4, pairs);
  EXPECT_EQ(A.row_start, (std::vector<int>{0, 3, 4, 6, 8}));
  EXPECT_EQ(A.column, (std::vector<int>{0, 2, 3, 1, 0, 2, 0, 3}));
  EXPECT_EQ(A.diagonal, (std::vector<int>{0, 3, 5, 7}));
  EXPECT_EQ(A.find(3, 0), 6);
}

TEST(BlockMatrix, MultipliesAsADenseMatrix) {
  constexpr double kRounding = 1e-14;
  constexpr int n = 5;
  Eigen::Matrix2Xi pairs(2, 3);
  pairs << 0, 1, 4,  //
      3, 2, 0;
  BlockMatrix A = make_block_matrix(n, pairs);
  meshing::Random random(7);
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(3 * n, 3 * n);
  for (int i = 0; i < n; ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k) {
      for (double& c : A.block[k].reshaped()) c = random.uniform();
      dense.block<3, 3>(3 * i, 3 * A.column[k]) = A.block[k];
    }
  Eigen::Matrix3Xd x(3, n), y;
  for (double& c : x.reshaped()) c = random.uniform();
  multiply(A, x, y);
  EXPECT_LT((y.reshaped() - dense * x.reshaped()).norm(), kRounding * dense.norm() * x.norm());
}

TEST(BlockMatrix, TakesBlocksWithinAndOutsideItsPattern) {
  constexpr double kRounding = 1e-14;
  constexpr int n = 5;
  Eigen::Matrix2Xi pairs(2, 2);
  pairs << 0, 1,  //
      3, 2;
  BlockMatrix A = make_block_matrix(n, pairs);
  for (Eigen::Matrix3d& block : A.block) block.setRandom();
  std::vector<SymmetricBlock> blocks;
  for (const auto& [i, j] : {std::pair(3, 0), std::pair(4, 1), std::pair(2, 2), std::pair(4, 1)})
    blocks.push_back({i, j, Eigen::Matrix3d::Random()});
  blocks[2].block = (blocks[2].block + blocks[2].block.transpose()).eval();
  EXPECT_EQ(A.find_any(4, 1), -1);
  const BlockMatrix sum = with_blocks(A, blocks);
  EXPECT_GE(sum.find_any(4, 1), 0);
  EXPECT_GE(sum.find_any(1, 4), 0);
  const Eigen::Matrix3Xd x = Eigen::Matrix3Xd::Random(3, n);
  Eigen::Matrix3Xd expected, y;
  multiply(A, x, expected);
  add_product(blocks, x, expected);
  multiply(sum, x, y);
  EXPECT_LT((y - expected).norm(), kRounding * y.norm());
}

TEST(BlockMatrix, MirrorsTheUpperHalf) {
  Eigen::Matrix2Xi pairs(2, 4);
  pairs << 0, 1, 4, 1,  //
      3, 2, 0, 4;
  BlockMatrix A = make_block_matrix(5, pairs);
  for (Eigen::Matrix3d& block : A.block) block.setRandom();
  const BlockMatrix before = A;
  mirror(A);
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k) {
      const int j = A.column[k];
      EXPECT_EQ(A.block[k], i <= j ? before.block[k] : before.block[A.find(j, i)].transpose());
    }
}

}  // namespace
}  // namespace testbed::massspring
