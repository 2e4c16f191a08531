#include <gtest/gtest.h>

#include "meshing/base/random.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/shells.h"
#include "meshing/surface/surface_tree.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

constexpr double kRounding = 1e-12;

SurfaceMesh hollow_torus_and_ball() {
  const SurfaceMesh torus = make_shape("torus", 300), ball = make_shape("ball", 162);
  return join(join(torus, inside_out(shifted(scaled(ball, 0.1), {1, 0, 0}))), shifted(ball, {0, 0, 2}));
}

Eigen::Vector3d random_point(Random& random) {
  return Eigen::Vector3d(random.uniform(), random.uniform(), random.uniform()) * 5 -
         Eigen::Vector3d(2.5, 2.5, 1.5);
}

/// Smallest distance to a dense sample of the triangle: an upper bound that falls with the sampling.
double distance_by_sampling(const Eigen::Vector3d& x, const SurfaceMesh& mesh, int n) {
  double best = 1e300;
  for (const auto& f : mesh.F.colwise())
    for (int i = 0; i <= n; ++i)
      for (int j = 0; i + j <= n; ++j) {
        const double u = double(i) / n, v = double(j) / n;
        const Eigen::Vector3d p =
            (1 - u - v) * mesh.X.col(f[0]) + u * mesh.X.col(f[1]) + v * mesh.X.col(f[2]);
        best = std::min(best, (x - p).norm());
      }
  return best;
}

}  // namespace

TEST(SurfaceTree, DistanceIsThatToTheTrianglesNotToTheVertices) {
  const SurfaceMesh mesh = hollow_torus_and_ball();
  const SurfaceTree tree(mesh);
  Random random(3);
  constexpr int kN = 12;
  // Half an edge of a sampling triangle: the longest edge here is below 0.7.
  constexpr double kGap = 0.35 / kN;
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Vector3d x = random_point(random);
    const double sampled = distance_by_sampling(x, mesh, kN), exact = tree.nearest(x).distance;
    EXPECT_LE(exact, sampled + kRounding);
    EXPECT_GE(exact, sampled - kGap);
    EXPECT_NEAR((tree.nearest(x).point - x).norm(), exact, kRounding);
  }
}

TEST(SurfaceTree, DistanceToEveryEdgeAndCornerOfATriangleIsRight) {
  // A sheet of two triangles that number their corners alike: no neighbour gives what one of them misses.
  for (int turn = 0; turn < 3; ++turn) {
    SurfaceMesh sheet{Eigen::Matrix3Xd::Zero(3, 3), Eigen::Matrix3Xi(3, 2)};
    sheet.X.col((turn + 1) % 3) << 1, 0, 0;
    sheet.X.col((turn + 2) % 3) << 0, 1, 0;
    sheet.F << 0, 2, 1, 1, 2, 0;
    const SurfaceTree tree(sheet);
    Random random(7);
    for (int trial = 0; trial < 200; ++trial) {
      const Eigen::Vector3d x = 0.5 * random_point(random);
      const double sampled = distance_by_sampling(x, sheet, 100), exact = tree.nearest(x).distance;
      EXPECT_LE(exact, sampled + kRounding);
      EXPECT_GE(exact, sampled - 0.01) << "a sampling triangle's longest edge is 0.014";
    }
  }
}

TEST(SurfaceTree, SideAgreesWithTheWindingNumber) {
  const SurfaceMesh mesh = hollow_torus_and_ball();
  const SurfaceTree tree(mesh);
  Random random(4);
  int n_inside = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    const Eigen::Vector3d x = random_point(random);
    const bool is_inside = winding_number(x, mesh.X, mesh.F) > 0.5;
    n_inside += is_inside;
    EXPECT_EQ(tree.depth(x) > 0, is_inside);
  }
  EXPECT_GT(n_inside, 100);
}

TEST(SurfaceTree, SideIsRightBeyondSharpVerticesAndEdges) {
  // beyond a thin spike the nearest feature is its tip, whose faces disagree about the side
  SurfaceMesh spike{Eigen::Matrix3Xd(3, 4), Eigen::Matrix3Xi(3, 4)};
  spike.X << 0, 0.01, 0, 0,  //
      0, 0, 0.01, 0,         //
      0, 0, 0, 1;
  spike.F << 0, 0, 0, 1,  //
      2, 1, 3, 2,         //
      1, 3, 2, 3;
  const SurfaceTree tree(spike);
  Random random(5);
  for (int trial = 0; trial < 2000; ++trial) {
    const Eigen::Vector3d x(0.1 * random.uniform() - 0.05, 0.1 * random.uniform() - 0.05,
                            0.2 * random.uniform() + 0.9);
    EXPECT_EQ(tree.depth(x) > 0, winding_number(x, spike.X, spike.F) > 0.5);
  }
}

TEST(SurfaceTree, SegmentsCrossWhereTheirEndsLieOnDifferentSides) {
  const SurfaceMesh torus = make_shape("torus", 300);
  const SurfaceTree tree(torus);
  Random random(6);
  int n_crossing = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    const Eigen::Vector3d a = 0.7 * random_point(random), b = 0.7 * random_point(random);
    // brute force: the segment leaves or enters the body somewhere along a fine walk
    bool is_changing = false;
    for (int step = 1; step <= 100; ++step)
      is_changing |= (tree.depth(a) > 0) != (tree.depth(a + step / 100.0 * (b - a)) > 0);
    n_crossing += is_changing;
    EXPECT_TRUE(!is_changing || tree.crosses(a, b));
    EXPECT_FALSE(tree.depth(a) > (b - a).norm() && tree.crosses(a, b));
  }
  EXPECT_GT(n_crossing, 100);
}

TEST(SurfaceTree, TrianglesAtTheEndsOfASegmentDoNotCount) {
  const SurfaceMesh torus = make_shape("torus", 300);
  const SurfaceTree tree(torus);
  const Eigen::Vector3d inside(1, 0, 0), vertex = torus.X.col(0), across = -vertex;
  EXPECT_FALSE(tree.crosses(inside, vertex, -1, 0));
  EXPECT_TRUE(tree.crosses(inside, across, -1, -1));
}
