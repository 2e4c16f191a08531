#include <gtest/gtest.h>

#include "meshing/algebra/cholesky.h"
#include "meshing/base/random.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;

/// Nodes of a cubic grid, each tied to the next along every axis by a random block: wide and narrow
/// supernodes, and a permutation that is none of the rows' own.
BlockMatrix grid(int n, std::uint64_t seed) {
  Random random(seed);
  std::vector<int> ends;
  const int strides[] = {1, n, n * n};
  for (int i = 0; i < n * n * n; ++i)
    for (const int stride : strides)
      if (i / stride % n + 1 < n) ends.insert(ends.end(), {i, i + stride});
  const Eigen::Map<const Eigen::Matrix2Xi> pairs(ends.data(), 2, static_cast<Eigen::Index>(ends.size()) / 2);
  BlockMatrix A = make_block_matrix(n * n * n, pairs);
  for (const auto& pair : pairs.colwise()) {
    Eigen::Matrix3d B;
    for (double& b : B.reshaped()) b = random.uniform() - 0.5;
    A.block[A.find(pair(0), pair(1))] = B;
    A.block[A.find(pair(1), pair(0))] = B.transpose();
    A.block[A.find(pair(0), pair(0))] += Eigen::Matrix3d::Identity() + B * B.transpose();
    A.block[A.find(pair(1), pair(1))] += Eigen::Matrix3d::Identity() + B.transpose() * B;
  }
  return A;
}

TEST(SinglePrecisionFactor, SolvesAsTheFactorItRoundsAndOfAnUpdateToo) {
  constexpr double kSingle = 1e-5;
  constexpr int n = 9;
  Random random(1);
  Matrix3Xd b(3, n * n * n), x;
  for (double& c : b.reshaped()) c = random.uniform() - 0.5;
  PaddedField r, z;
  pad(b, 1, r);
  BlockCholesky factor(grid(n, 1));
  for (const std::uint64_t seed : {1, 2}) {
    if (seed > 1) factor.update(grid(n, seed));
    ASSERT_TRUE(factor.is_ok());
    factor.solve(b, x);
    const SinglePrecisionFactor single = factor.single_precision();
    std::size_t widest = 0;
    for (const SinglePrecisionFactor::Supernode& s : single.supernodes)
      widest = std::max<std::size_t>(widest, s.n_columns);
    EXPECT_GT(widest, 16);
    const double rz = single.solve(r, z);
    EXPECT_NEAR(rz, b.cwiseProduct(x).sum(), kSingle * std::abs(rz));
    EXPECT_EQ(z.bottomRows<1>().norm(), 0);
    Matrix3Xd difference = -x;
    add_unpadded(z, 1, difference);
    EXPECT_LT(difference.norm(), kSingle * x.norm());
  }
}

}  // namespace
}  // namespace testbed::meshing
