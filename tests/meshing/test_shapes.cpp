#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "meshing/shapes.h"
#include "meshing/surface.h"

namespace testbed {
namespace {

class Shapes : public testing::TestWithParam<std::string> {};

TEST_P(Shapes, AreClosedAndOutwardAtEverySize) {
  for (int n : {60, 162, 500, 932, 3897}) {
    const SurfaceMesh mesh = make_shape(GetParam(), n);
    EXPECT_NO_THROW(check_closed(mesh, GetParam())) << n;
    EXPECT_NEAR(mesh.X.cols(), n, 0.31 * n);  // a geodesic ball has 42 or 92 vertices when asked for 60
  }
}

TEST_P(Shapes, AreScaledToTheSizeAskedFor) {
  const Eigen::Vector3d size(2, 0.5, 3);
  const SurfaceMesh mesh = make_shape(GetParam(), 500, size);
  const Eigen::Vector3d extent = mesh.X.rowwise().maxCoeff() - mesh.X.rowwise().minCoeff();
  EXPECT_LT((extent - size).norm(), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(All, Shapes, testing::ValuesIn(shape_names()),
                         [](auto& info) { return info.param; });

TEST(MakeShape, MeetsThePapersVertexCounts) {
  for (const auto& [name, n] : {std::pair{"ball", 162}, {"torus", 924}, {"handle", 932}, {"head", 3897}})
    EXPECT_EQ(make_shape(name, n).X.cols(), n) << name;
}

TEST(MakeShape, TorusHasGenusOne) {
  const SurfaceMesh mesh = make_shape("torus", 924);
  EXPECT_EQ(mesh.X.cols() - edges_of(mesh.F).cols() + mesh.F.cols(), 0);
}

// The polyhedron inscribed in a smooth body loses volume as the square of its edge: the constant is that of a
// few triangles.
TEST(MakeShape, VolumesConvergeToTheSmoothBodies) {
  constexpr double kPi = 3.14159265358979;
  const double torus = 2 * kPi * kPi * 0.35 * 0.35, ball = 4 * kPi / 3;
  for (const auto& [name, exact] : {std::pair{"torus", torus}, {"ball", ball}}) {
    const SurfaceMesh coarse = make_shape(name, 642), fine = make_shape(name, 4 * 642);
    const double error = 1 - volume(coarse.X, coarse.F) / exact, finer = 1 - volume(fine.X, fine.F) / exact;
    EXPECT_GT(error, 0) << name;
    EXPECT_NEAR(std::log2(error / finer), 2, 0.2) << name;
  }
}

TEST(MakeShape, RefusesUnknownNamesAndTooFewVertices) {
  EXPECT_THROW(make_shape("cow", 500), std::runtime_error);
  EXPECT_THROW(make_shape("head", 5), std::runtime_error);
}

}  // namespace
}  // namespace testbed
