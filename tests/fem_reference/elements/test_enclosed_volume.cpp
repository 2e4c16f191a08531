#include <gtest/gtest.h>

#include "fem_reference/elements/enclosed_volume.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;

Matrix3Xd curved_triangle(int n) {
  Matrix3Xd x(3, 6);
  x << 0, 1, .1, .5, .6, 0,   //
      .1, 0, 1, -.1, .6, .5,  //
      1, 1.1, .9, 1.2, 1, 1.1;
  return x.leftCols(n);
}

TEST(EnclosedVolume, OfAClosedSurfaceIsItsVolume) {
  const TetMesh box = box_tets(2, 1, 1, 1, 0.2);
  double sum = 0;
  for (int f = 0; f < box.F.cols(); ++f) sum += enclosed_volume(box.X(Eigen::all, box.F.col(f))).volume;
  EXPECT_NEAR(sum, volume(box.X, box.F), 1e-14);
}

// Over the unit triangle of the plane, z = 1 + a x y between it and the origin: (1/2 - a/24) / 3.
TEST(EnclosedVolume, OfSixNodesIsThatUnderTheCurvedTriangle) {
  for (double a : {0., 0.7}) {
    Matrix3Xd x(3, 6);
    x << 0, 1, 0, .5, .5, 0,  //
        0, 0, 1, 0, .5, .5,   //
        1, 1, 1, 1, 1 + a / 4, 1;
    EXPECT_NEAR(enclosed_volume(x).volume, (0.5 - a / 24) / 3, 1e-14);
  }
}

// Squares of the barycentric coordinates: sqrt(x) + sqrt(y) + sqrt(z) = 1, under which there is 1/90.
TEST(EnclosedVolume, OfATriangleCurvedInEveryDirectionIsItsIntegral) {
  Matrix3Xd x(3, 6);
  x << 1, 0, 0, .25, 0, .25,  //
      0, 1, 0, .25, .25, 0,   //
      0, 0, 1, 0, .25, .25;
  EXPECT_NEAR(enclosed_volume(x).volume, 1. / 90, 1e-15);
}

TEST(EnclosedVolume, DerivativesAreDifferences) {
  constexpr double h = 1e-4, kTolerance = 1e-7;  // central differences of a cubic
  for (int n : {3, 6}) {
    const Matrix3Xd x = curved_triangle(n);
    const EnclosedVolume v = enclosed_volume(x);
    EXPECT_GT(v.gradient.norm(), 0.1);
    EXPECT_GT(v.hessian.norm(), 0.1);
    for (int k = 0; k < 3 * n; ++k) {
      Matrix3Xd plus = x, minus = x;
      plus.data()[k] += h;
      minus.data()[k] -= h;
      const EnclosedVolume above = enclosed_volume(plus), below = enclosed_volume(minus);
      EXPECT_NEAR(v.gradient.data()[k], (above.volume - below.volume) / (2 * h), kTolerance);
      EXPECT_LT((v.hessian.col(k) - (above.gradient - below.gradient).reshaped() / (2 * h)).norm(),
                kTolerance);
    }
  }
}

}  // namespace
}  // namespace testbed::fem
