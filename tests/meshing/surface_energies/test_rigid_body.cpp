#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "meshing/base/random.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface_io.h"
#include "meshing/surface_energies/rigid_body.h"

namespace testbed::meshing {
namespace {

using Eigen::Vector3d;

constexpr double kRounding = 1e-12;

RigidBody body_of(const decltype(Obstacle::shape)& shape) {
  Obstacle obstacle;
  obstacle.shape = shape;
  return RigidBody(obstacle);
}

Vector3d random_point(Random& random) {
  return 4 * Vector3d(random.uniform() - 0.5, random.uniform() - 0.5, random.uniform() - 0.5);
}

/// The share of the way from x to y at which a convex body first comes within `least`, by thirds of the way to the nearest, then halves.
std::optional<double> first_share(const RigidBody& body, const Vector3d& x, const Vector3d& y, double least) {
  const auto gap = [&](double share) { return body.gap(x + share * (y - x), 0).distance - least; };
  double low = 0, high = 1;
  for (int n = 0; n < 100; ++n) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    if (gap(a) < gap(b))
      high = b;
    else
      low = a;
  }
  if (gap(low) > 0) return {};
  high = low;
  low = 0;
  for (int n = 0; n < 100; ++n) (gap((low + high) / 2) > 0 ? low : high) = (low + high) / 2;
  return high;
}

TEST(RigidBody, ConvexOnesAreFirstTouchedWhereBisectionFindsIt) {
  constexpr double kLeast = 1e-6;
  Random random(1);
  for (const RigidBody& body :
       {body_of(Ball{{0.1, 0, 0}, 0.5}), body_of(Capsule{{-1, 0, 0}, {1, 0.3, 0}, 0.2}),
        body_of(Box{{-0.5, -0.3, -1}, {0.4, 0.7, 1}})}) {
    int n_touching = 0, n_passing = 0;
    while (n_touching < 200 || n_passing < 200) {
      const Vector3d x = random_point(random), y = random_point(random);
      if (body.gap(x, 0).distance < kLeast) continue;
      const auto expected = first_share(body, x, y, kLeast);
      const auto found = body.first_touch(x, y, 0, 0, kLeast);
      ++(expected ? n_touching : n_passing);
      ASSERT_EQ(found.has_value(), expected.has_value());
      if (!found) continue;
      EXPECT_LT((*found - x - *expected * (y - x)).norm(), 1e-6 * (y - x).norm());
      EXPECT_NEAR(body.gap(*found, 0).distance, kLeast, 2e-3 * kLeast);
    }
  }
}

TEST(RigidBody, InOtherAxesIsTheSameBodyOnTheSameWay) {
  const Eigen::Matrix3d frame = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).matrix();
  Random random(2);
  const decltype(Obstacle::shape) half = HalfSpace{{0.1, 0, 0}, {1, 2, 0}}, ball = Ball{{0.1, 0, 0}, 0.5};
  for (const auto& shape : {half, ball}) {
    Obstacle obstacle;
    obstacle.shape = shape;
    obstacle.motion = {{0, 0, 0, 0}, {1, 0.5, -1, 2}};
    const RigidBody along_axes(obstacle), turned(obstacle, frame);
    for (const double t : {0., 0.4, 1.}) {
      EXPECT_LT((frame * turned.translation(t) - along_axes.translation(t)).norm(), kRounding);
      const Vector3d x = random_point(random);
      const RigidBody::Gap expected = along_axes.gap(x, t), found = turned.gap(frame.transpose() * x, t);
      EXPECT_NEAR(found.distance, expected.distance, kRounding) << t;
      EXPECT_LT((frame * found.normal - expected.normal).norm(), kRounding) << t;
    }
  }
}

TEST(RigidBody, AMeshThatIsNotConvexIsTouchedBeyondItsHole) {
  const SurfaceMesh torus = make_shape("torus", 300);
  const std::string file = testing::TempDir() + "rigid_torus.off";
  write_surface(file, torus);
  Eigen::Index inmost;
  torus.X.colwise().norm().minCoeff(&inmost);
  const Vector3d rim = torus.X.col(inmost);
  const auto found = body_of(ClosedMesh{file}).first_touch(-0.2 * rim, 2 * rim, 0, 0, 1e-6);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT((*found - rim).norm(), 1e-3 * rim.norm());
}

}  // namespace
}  // namespace testbed::meshing
