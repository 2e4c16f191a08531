// Bodies that begin inside obstacles: the way out, and the statics that press what supports hold.
#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "meshing/surface/shapes.h"
#include "meshing/surface_energies/initial_overlap.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

const SurfaceMesh kCube = make_shape("bar", 60, {1, 1, 1});  // from the origin on

Obstacle plane(const Vector3d& point, const Vector3d& normal, Overlap initially = Overlap::Resolve) {
  Obstacle obstacle;
  obstacle.shape = HalfSpace{point, normal};
  obstacle.initially = initially;
  return obstacle;
}

Obstacle floor_at(double height, Overlap initially = Overlap::Resolve) {
  return plane({0, height, 0}, {0, 1, 0}, initially);
}

std::vector<RigidBody> bodies_of(const std::vector<Obstacle>& obstacles,
                                 const Matrix3d& frame = Matrix3d::Identity()) {
  std::vector<RigidBody> bodies;
  for (const Obstacle& obstacle : obstacles) bodies.emplace_back(obstacle, frame);
  return bodies;
}

Vector3d way(const std::vector<Obstacle>& obstacles) {
  return way_beside(bodies_of(obstacles), kCube.X, kCube.F);
}

/// Whether they are refused with a message that holds this text.
testing::AssertionResult is_refused(const std::vector<Obstacle>& obstacles, const std::string& text) {
  try {
    way(obstacles);
  } catch (const std::runtime_error& error) {
    const std::string said = error.what();
    if (said.find(text) != std::string::npos) return testing::AssertionSuccess();
    return testing::AssertionFailure() << said;
  }
  return testing::AssertionFailure() << "nothing is refused";
}

constexpr double kClose = 1e-6;  // m

TEST(WayBeside, LeadsOutOfEveryPlaneAlongItsNormal) {
  EXPECT_LT((way({floor_at(0.2)}) - Vector3d(0, 0.2, 0)).norm(), kClose);
  EXPECT_LT((way({floor_at(0.2), plane({0.9, 0, 0}, {-1, 0, 0})}) - Vector3d(-0.1, 0.2, 0)).norm(), kClose);
}

TEST(WayBeside, OfOneObstacleCountsForTheNext) {
  EXPECT_LT((way({floor_at(0.2), floor_at(0.5)}) - Vector3d(0, 0.5, 0)).norm(), kClose);
  EXPECT_LT((way({floor_at(0.5), floor_at(0.2)}) - Vector3d(0, 0.5, 0)).norm(), kClose);
}

TEST(WayBeside, IsZeroWhereNothingMayOverlapOrTheBodyOnlyTouches) {
  EXPECT_EQ(way({floor_at(0), floor_at(-1)}), Vector3d::Zero());
  EXPECT_EQ(way({floor_at(0.2, Overlap::Refuse)}), Vector3d::Zero());
}

TEST(WayBeside, OfAMovingObstacleStartsWhereItBegins) {
  Obstacle moving = floor_at(-1);
  moving.motion = {{0, 0, 1.2, 0}, {1, 0, 5, 0}};
  EXPECT_LT((way({moving}) - Vector3d(0, 0.2, 0)).norm(), kClose);
}

TEST(WayBeside, IsRefusedIntoAnotherObstacleAndOutOfOneOnAllSides) {
  EXPECT_TRUE(is_refused({floor_at(0.2), plane({0, 1.1, 0}, {0, -1, 0}, Overlap::Refuse)},
                         "obstacles[1]: the body, moved out of what it overlaps, lies 0.1 m inside"));
  EXPECT_TRUE(is_refused({floor_at(2)}, "obstacles[0] begins around the body"));
  Obstacle core = floor_at(0);
  core.shape = Ball{{0.5, 0.5, 0.5}, 0.6};
  EXPECT_TRUE(is_refused({core}, "on all sides"));
}

/// A cube of which a floor holds a fifth, with all that can drive it.
Scene driven() {
  Scene scene;
  scene.gravity = Vector3d(0, -9.81, 0);
  scene.time.mode = TimeMode::Dynamic;
  scene.loads.emplace_back();
  scene.initial.emplace_back();
  scene.collapse.emplace();
  scene.load_scale.factor = 2;
  scene.obstacles = {floor_at(0.2), floor_at(-3, Overlap::Refuse)};
  scene.obstacles[0].friction = 0.5;
  Support ends, moves;
  ends.end = 0.5;
  ends.displacement = {1, 0, 0};
  moves.motion = {{0, 0, 0.1, 0}, {1, 0, 9, 0}};
  scene.supports = {ends, moves};
  scene.volume.emplace();
  scene.volume->target = {{0, 1.5}, {1, 2}};
  return scene;
}

TEST(WithoutOverlap, IsStaticsInWhichNothingActsButObstaclesOnTheirWayIn) {
  const Scene scene = driven();
  const auto statics = without_overlap(scene, bodies_of(scene.obstacles), kCube.X, kCube.F);
  ASSERT_TRUE(statics);
  EXPECT_EQ(statics->time.mode, TimeMode::Static);
  EXPECT_EQ(law_of(*statics), law_of(scene));
  EXPECT_FALSE(statics->gravity);
  EXPECT_TRUE(statics->loads.empty());
  EXPECT_TRUE(statics->initial.empty());
  EXPECT_FALSE(statics->collapse);
  EXPECT_EQ(load_factor_of(*statics), 1);
  EXPECT_EQ(statics->obstacles[0].friction, 0);
  EXPECT_EQ(statics->obstacles[0].initially, Overlap::Refuse);
  for (const double load_factor : {0., 0.5, 1.}) {
    EXPECT_EQ(position_at(statics->supports[1].motion, load_factor), Vector3d(0, 0.1, 0));
    EXPECT_EQ(position_at(statics->supports[0].motion, load_factor), Vector3d::Zero());
    EXPECT_EQ(value_at(statics->volume->target, load_factor), 1.5);
  }
  EXPECT_TRUE(statics->supports[0].displacement.isZero(0));
  EXPECT_FALSE(statics->supports[0].end);
  EXPECT_LT((position_at(statics->obstacles[0].motion, 0) - Vector3d(0, -0.2, 0)).norm(), kClose);
  EXPECT_EQ(position_at(statics->obstacles[0].motion, 1), Vector3d::Zero());
  EXPECT_EQ(position_at(statics->obstacles[1].motion, 0), Vector3d::Zero());
}

TEST(WithoutOverlap, MovesAnObstacleToWhereItIsAsItsMotionBegins) {
  Scene scene = driven();
  scene.obstacles[0] = floor_at(-1);
  scene.obstacles[0].motion = {{0, 0, 1.2, 0}, {1, 0, 5, 0}};
  const auto statics = without_overlap(scene, bodies_of(scene.obstacles), kCube.X, kCube.F);
  ASSERT_TRUE(statics);
  EXPECT_LT((position_at(statics->obstacles[0].motion, 0) - Vector3d(0, 1, 0)).norm(), kClose);
  EXPECT_EQ(position_at(statics->obstacles[0].motion, 1), Vector3d(0, 1.2, 0));
}

TEST(WithoutOverlap, IsOneSceneWhateverTheAxesOfTheNodes) {
  const Scene scene = driven();
  const Matrix3d frame = Eigen::AngleAxisd(0.5, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  const auto statics =
      without_overlap(scene, bodies_of(scene.obstacles, frame), frame.transpose() * kCube.X, kCube.F, frame);
  ASSERT_TRUE(statics);
  EXPECT_LT((position_at(statics->obstacles[0].motion, 0) - Vector3d(0, -0.2, 0)).norm(), kClose);
}

TEST(WithoutOverlap, IsAbsentWhereNothingMayOverlapOrTheBodyOnlyTouches) {
  for (const Obstacle& obstacle : {floor_at(0), floor_at(0.2, Overlap::Refuse)}) {
    Scene scene = driven();
    scene.obstacles = {obstacle};
    EXPECT_FALSE(without_overlap(scene, bodies_of(scene.obstacles), kCube.X, kCube.F));
  }
}

}  // namespace
}  // namespace testbed::meshing
