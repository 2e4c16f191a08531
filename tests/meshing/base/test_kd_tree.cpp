#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "meshing/base/kd_tree.h"
#include "meshing/base/random.h"

using namespace testbed::meshing;

namespace {

Eigen::Matrix3Xd random_points(int n, Random& random) {
  // on a coarse lattice, so that many distances are equal
  return Eigen::Matrix3Xd::NullaryExpr(3, n, [&] { return std::floor(10 * random.uniform()); });
}

}  // namespace

TEST(KdTree, FindsWhatBruteForceFindsWhilePointsAreTakenAway) {
  Random random(1);
  const Eigen::Matrix3Xd points = random_points(500, random);
  KdTree tree(points);
  std::vector<bool> is_left(500, true);
  auto tie = [](int i) { return i * 7 % 5; };
  for (int round = 0; round < 500; ++round) {
    const Eigen::Vector3d x = random_points(1, random);
    std::vector<int> expected;
    for (int i = 0; i < 500; ++i)
      if (is_left[i]) expected.push_back(i);
    std::sort(expected.begin(), expected.end(), [&](int i, int j) {
      return std::tuple((points.col(i) - x).squaredNorm(), tie(i), i) <
             std::tuple((points.col(j) - x).squaredNorm(), tie(j), j);
    });
    if (expected.size() > 6) expected.resize(6);
    EXPECT_EQ(tree.nearest(x, 6, tie), expected);
    const int gone = static_cast<int>(random.below(500));
    if (is_left[gone]) {
      tree.remove(gone);
      is_left[gone] = false;
    }
  }
  EXPECT_EQ(tree.n_left(), std::count(is_left.begin(), is_left.end(), true));
}

TEST(KdTree, EmptyOneFindsNothing) {
  const Eigen::Matrix3Xd none(3, 0);
  EXPECT_TRUE(KdTree(none).nearest({0, 0, 0}, 3).empty());
}
