#include <gtest/gtest.h>

#include "meshing/scene/initial_motion.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/// Four nodes on a line, the last of them heavy.
struct Line {
  Matrix3Xd X = (Matrix3Xd(3, 4) << 0, 1, 2, 4, 0, 0, 0, 0, 0, 0, 0, 0).finished();
  Eigen::VectorXd mass = Eigen::Vector4d(1, 1, 1, 3);
  Scene scene;
  Matrix3Xd velocity() const { return initial_velocity(scene, X, mass, box_of(X)); }
};

TEST(InitialMotion, IsRestWhereTheSceneHasNone) {
  EXPECT_EQ(Line().velocity(), Matrix3Xd::Zero(3, 4));
}

TEST(InitialMotion, TurnsARegionAboutTheCentreOfItsMasses) {
  Line line;
  InitialMotion right;
  right.region.shape = HalfSpace{Vector3d(1.5, 0, 0), Vector3d(-1, 0, 0)};
  right.spin = Vector3d(0, 0, 2);
  line.scene.initial = {right};  // nodes at 2 m and 4 m, their centre at 3.5 m
  Matrix3Xd expected = Matrix3Xd::Zero(3, 4);
  expected(1, 2) = -3;
  expected(1, 3) = 1;
  EXPECT_EQ(line.velocity(), expected);
  EXPECT_EQ(line.velocity() * line.mass, Vector3d::Zero());
}

TEST(InitialMotion, AddsUpWhereRegionsOverlap) {
  Line line;
  InitialMotion all, half;
  all.velocity = Vector3d(1, 2, 3);
  half.region.shape = Box{Vector3d(0, 0, 0), Vector3d(0.5, 0, 0)};
  half.region.relative = true;  // nodes up to 2 m
  half.velocity = Vector3d(0, 0, 5);
  line.scene.initial = {all, half};
  const Matrix3Xd v = line.velocity();
  EXPECT_EQ(v.col(2), Vector3d(1, 2, 8));
  EXPECT_EQ(v.col(3), Vector3d(1, 2, 3));
}

TEST(InitialMotion, RefusesARegionWithoutNodesAndShowsTheBody) {
  Line line;
  line.scene.initial.resize(2);
  line.scene.initial[1].region.shape = Ball{Vector3d(0, 5, 0), 1};
  try {
    line.velocity();
    ADD_FAILURE() << "accepted";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(),
                 "initial.1: no node lies in its region, expected one that meets the body, from (0 0 0) to "
                 "(4 0 0) m");
  }
}

}  // namespace
}  // namespace testbed::meshing
