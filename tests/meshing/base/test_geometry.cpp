#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "meshing/base/geometry.h"
#include "meshing/base/random.h"

using namespace testbed::meshing;

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kRounding = 1e-12;

Matrix3d random_corners(Random& random) {
  return Matrix3d::NullaryExpr([&] { return random.uniform(); });
}

/// The triangles are wide and the points far out, so that every feature is nearest to some.
template <class Check>
void for_random_points(const Check& check) {
  Random random(1);
  for (int n = 0; n < 300; ++n) {
    const Matrix3d corners = random_corners(random);
    const Vector3d p = 4 * (random_corners(random).col(0) - Vector3d::Constant(0.5));
    check(p, corners, nearest_on_triangle(p, corners.col(0), corners.col(1), corners.col(2)));
  }
}

}  // namespace

TEST(TetVolume, IsASixthOfTheDeterminantOfTheEdges) {
  Eigen::Matrix3Xd X(3, 5);
  X << 9, 1, 3, 1, 1,  //
      9, 1, 1, 4, 1,   //
      9, 1, 1, 1, 6;
  EXPECT_NEAR(tet_volume(X, {1, 2, 3, 4}), 2 * 3 * 5 / 6., kRounding);
  EXPECT_NEAR(tet_volume(X, {2, 1, 3, 4}), -2 * 3 * 5 / 6., kRounding);
}

TEST(BarycentricGradients, TellTheCoordinatesOfTheCorners) {
  Random random(1);
  const Eigen::Matrix3Xd X = Eigen::Matrix3Xd::NullaryExpr(3, 4, [&] { return random.uniform(); });
  const Eigen::Matrix<double, 3, 4> g = barycentric_gradients(X, {0, 1, 2, 3});
  for (int i = 0; i < 4; ++i)
    for (int k = 1; k < 4; ++k)
      EXPECT_NEAR(g.col(k).dot(X.col(i) - X.col(0)), i == k, 1e-10) << i << ' ' << k;
  EXPECT_LT(g.rowwise().sum().norm(), 1e-10);
}

// Elimination finds a determinant of zero for some of these.
TEST(BarycentricGradients, AreFiniteWhereverTheVolumeIsNotZero) {
  Random random(1);
  int n_flat = 0;
  for (int n = 0; n < 20'000; ++n) {
    Eigen::Matrix3Xd X(3, 4);
    X.leftCols<3>() = random_corners(random);
    X.col(3) = X.leftCols<3>() * Vector3d(0.25, 0.5, 0.25);  // within the first three, but for rounding
    if (tet_volume(X, {0, 1, 2, 3}) == 0) continue;
    ++n_flat;
    ASSERT_TRUE(barycentric_gradients(X, {0, 1, 2, 3}).allFinite()) << n;
  }
  EXPECT_GT(n_flat, 1000);
}

TEST(NearestOnTriangle, NoPointOfAFineGridOnItIsNearer) {
  for_random_points([](const Vector3d& p, const Matrix3d& corners, const OnTriangle& nearest) {
    constexpr int n = 20;
    double least = std::numeric_limits<double>::infinity();
    for (int i = 0; i <= n; ++i)
      for (int j = 0; i + j <= n; ++j)
        least = std::min(least, (p - corners * Vector3d(n - i - j, i, j) / n).norm());
    const double distance = (p - nearest.point).norm();
    EXPECT_LE(distance, least + kRounding);
    EXPECT_GE(distance, least - 1. / n) << "the grid is as fine as this";
  });
}

TEST(NearestOnTriangle, WeightsAreThoseOfThePointAndTellItsFeature) {
  std::array<int, 7> n_met{};
  for_random_points([&](const Vector3d&, const Matrix3d& corners, const OnTriangle& nearest) {
    const Vector3d& w = nearest.weights;
    EXPECT_LT((corners * w - nearest.point).norm(), kRounding);
    EXPECT_NEAR(w.sum(), 1, kRounding);
    EXPECT_GE(w.minCoeff(), 0);
    const int feature = nearest.feature;
    ++n_met[feature + 1];
    for (int c = 0; c < 3; ++c) {
      const bool is_met = feature < 0 || (feature < 3 ? c != (feature + 2) % 3 : c == feature - 3);
      EXPECT_EQ(w[c] > 0, is_met) << "corner " << c << ", feature " << feature;
    }
  });
  for (int n : n_met) EXPECT_GT(n, 0);
}
