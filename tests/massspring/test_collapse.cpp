#include <gtest/gtest.h>

#include <cmath>

#include "massspring/collapse.h"

namespace testbed {
namespace {

constexpr double kRounding = 1e-14;

/// The unit tetrahedron's six edges; its bounding box measures 1 m a side, so that distances are the
/// normalised ones.
SpringNetwork tetrahedron() {
  SpringNetwork network;
  network.X.resize(3, 4);
  network.X << 0, 1, 0, 0,  //
      0, 0, 1, 0,           //
      0, 0, 0, 1;
  network.E.resize(2, 6);
  network.E << 0, 0, 0, 1, 1, 2,  //
      1, 2, 3, 2, 3, 3;
  network.n_surface = 4;
  return network;
}

TEST(Collapse, FallsOffWithTheDistanceFromPivotToSegment) {
  const SpringNetwork network = tetrahedron();
  // From (0.5, 0, -1): 1 to the edge along x, whose middle is nearest; sqrt(1.25) to the one along y, whose
  // end is.
  const Eigen::VectorXd w = fall_off({0.5, 0, -1}, network.E, network.X, 1);
  EXPECT_NEAR(w(0), 0.5, kRounding);
  EXPECT_NEAR(w(1), 1 / (1 + std::sqrt(1.25)), kRounding);
  EXPECT_NEAR(fall_off({0.5, 0, -1}, network.E, network.X, 2)(0), 1 / 1.5, kRounding)
      << "not in the box's units";
}

TEST(Collapse, StaticRestLengthsShrinkLinearlyFromThePivotsStart) {
  const SpringNetwork network = tetrahedron();
  const Collapse collapse{0.4, {{{0.5, 0, -1}, 0.5}}};
  const Eigen::VectorXd rest = Eigen::VectorXd::Constant(6, 2);
  EXPECT_EQ(collapsed(collapse, network, rest, 0.5), rest);
  EXPECT_NEAR(collapsed(collapse, network, rest, 0.75)(0), 2 * (1 - 0.4 * 0.5 * 0.5), kRounding);
  EXPECT_NEAR(collapsed(collapse, network, rest, 1)(0), 2 * (1 - 0.4 * 0.5), kRounding);
}

TEST(Collapse, DependsOnTheTimeAndNotOnTheStep) {
  const SpringNetwork network = tetrahedron();
  const Collapse options{0.4, {{{0.5, 0, -1}, 0}}};
  State once, often;
  once.x = often.x = network.X;
  once.rest_length = often.rest_length = Eigen::VectorXd::Ones(6);
  collapse(options, network, once, 1);
  EXPECT_NEAR(once.rest_length(0), 1 - 0.4 * 0.5, kRounding);
  for (int k = 0; k < 10; ++k) collapse(options, network, often, 0.1);
  EXPECT_LT((once.rest_length - often.rest_length).norm(), kRounding);
}

}  // namespace
}  // namespace testbed
