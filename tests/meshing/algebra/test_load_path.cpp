#include <gtest/gtest.h>

#include <cmath>

#include "meshing/algebra/load_path.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;

/// One point whose equilibrium at a load factor is at (factor^2, 0, 0), and which finds it only from near.
struct Point {
  double reach;
  int n_tried = 0, n_failed = 0;
  double start = 0;  ///< of the last trial
  LoadedBody body{[](double, Matrix3Xd&) {},
                  [](double factor, const Matrix3Xd& x) { return std::abs(x(0) - factor * factor); },
                  [this](double factor, Matrix3Xd& x) {
                    start = x(0);
                    ++n_tried;
                    const bool is_near = std::abs(factor * factor - x(0)) < reach;
                    n_failed += !is_near;
                    x(0) = is_near ? factor * factor : std::nan("");
                    return is_near;
                  }};
};

TEST(LoadPath, CutsAStepThatFailsAndGrowsAgainUntilTheLoadIsWhole) {
  Point point{0.05};
  LoadPath path(Matrix3Xd::Zero(3, 1));
  Matrix3Xd x = Matrix3Xd::Zero(3, 1);
  EXPECT_TRUE(path.follow(point.body, 1, x));
  EXPECT_DOUBLE_EQ(x(0), 1);
  EXPECT_EQ(path.load_factor(), 1);
  EXPECT_GE(point.n_failed, 3);             // 1, 1/2 and 1/4 are too far from rest
  EXPECT_LE(point.n_tried, 3 + 2 + 2 + 3);  // equal parts of 1/8 would be 8 and the three
}

TEST(LoadPath, EndsAtTheLastEquilibriumWhereThePathEnds) {
  Point point{0.05};
  LoadPath path(Matrix3Xd::Zero(3, 1));
  Matrix3Xd x = Matrix3Xd::Zero(3, 1);
  const auto within = point.body.balance;
  point.body.balance = [&](double factor, Matrix3Xd& x) { return within(factor, x) && factor <= 0.5; };
  EXPECT_FALSE(path.follow(point.body, 1, x));
  EXPECT_LE(x(0), 0.25);
  EXPECT_GT(x(0), 0.2);
  EXPECT_DOUBLE_EQ(x(0), path.load_factor() * path.load_factor());
  EXPECT_LT(point.n_tried, 40);
  EXPECT_TRUE(path.follow(point.body, 0.3, x));  // and goes on from there
  EXPECT_DOUBLE_EQ(x(0), 0.09);
}

TEST(LoadPath, AParabolaOfEquilibriaIsFoundBeforehandFromThreeOfThem) {
  Point point{10};
  LoadPath path(Matrix3Xd::Zero(3, 1));
  Matrix3Xd x = Matrix3Xd::Zero(3, 1);
  for (double factor : {0.2, 0.4, 0.7}) EXPECT_TRUE(path.follow(point.body, factor, x));
  EXPECT_NEAR(point.start, 0.49, 1e-14);
  EXPECT_EQ(point.n_tried, 3);
}

TEST(LoadPath, StaysWhereItIsWhereThatIsLowerInEnergyThanWhatTheLastEquilibriaPointTo) {
  Point point{10};
  LoadPath path(Matrix3Xd::Zero(3, 1));
  Matrix3Xd x = Matrix3Xd::Zero(3, 1);
  for (double factor : {0.1, 1.}) EXPECT_TRUE(path.follow(point.body, factor, x));
  const double before = x(0);
  point.body.energy = [](double, const Matrix3Xd& x) { return std::abs(x(0) - 1); };
  EXPECT_TRUE(path.follow(point.body, 1.5, x));
  EXPECT_EQ(point.start, before);
}

TEST(LoadPath, AnEquilibriumMetAgainTakesThePlaceOfTheFirst) {
  Point point{10};
  LoadPath path(Matrix3Xd::Zero(3, 1));
  Matrix3Xd x = Matrix3Xd::Zero(3, 1);
  for (double factor : {0., 0.5, 0.5, 0., 0.5, 1., 1.}) {
    EXPECT_TRUE(path.follow(point.body, factor, x));
    EXPECT_DOUBLE_EQ(x(0), factor * factor);
  }
}

}  // namespace
}  // namespace testbed::meshing
