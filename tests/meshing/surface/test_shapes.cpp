#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"

using namespace testbed::meshing;

namespace {
constexpr double kPi = 3.14159265358979323846;
constexpr double kRounding = 1e-12;
}  // namespace

TEST(Shapes, AreClosedForManySizes) {
  for (const auto& name : shape_names())
    for (int n : {90, 162, 250, 642, 924, 932, 1234, 3897}) {
      SCOPED_TRACE(name + " " + std::to_string(n));
      EXPECT_NO_THROW(check_closed(make_shape(name, n), name));
    }
}

TEST(Shapes, MeetTheVertexCountsOfThePaper) {
  EXPECT_EQ(make_shape("ball", 162).X.cols(), 162);
  EXPECT_EQ(make_shape("ball", 642).X.cols(), 642);
  EXPECT_EQ(make_shape("ball", 2562).X.cols(), 2562);
  EXPECT_EQ(make_shape("torus", 924).X.cols(), 924);
  EXPECT_EQ(make_shape("handle", 932).X.cols(), 932);
  EXPECT_EQ(make_shape("head", 3897).X.cols(), 3897);
}

TEST(Shapes, HaveTheGenusOfTheirName) {
  for (const auto& name : shape_names()) {
    const SurfaceMesh mesh = make_shape(name, 900);
    const long euler = mesh.X.cols() - edges_of(mesh.F).cols() + mesh.F.cols();
    EXPECT_EQ(euler, name == "torus" ? 0 : name == "hollow_ball" ? 4 : 2) << name;  // two surfaces
  }
}

TEST(Shapes, VolumesTendToTheClosedForms) {
  // Inscribed polyhedra: the defect is of order h^2, below 2 % at these counts.
  constexpr double kFaceting = 0.02;
  auto V = [](const SurfaceMesh& mesh) { return volume(mesh.X, mesh.F); };
  EXPECT_NEAR(V(make_shape("ball", 2562)) / (4 * kPi / 3), 1, kFaceting);
  EXPECT_NEAR(V(make_shape("torus", 2500)) / (2 * kPi * kPi * 0.4 * 0.4), 1, kFaceting);
  EXPECT_NEAR(V(make_shape("handle", 5000)) / (kPi * 0.01 * (0.8 + kPi * 0.5) + 4 * kPi / 3 * 0.001), 1,
              kFaceting);
  EXPECT_NEAR(V(make_shape("bar", 500)), 4, kRounding);
}

TEST(Shapes, FillTheSizeAskedFor) {
  const Eigen::Vector3d size(3, 0.5, 2);
  for (const auto& name : shape_names()) {
    const SurfaceMesh mesh = make_shape(name, 400, size);
    const Eigen::Vector3d box = mesh.X.rowwise().maxCoeff() - mesh.X.rowwise().minCoeff();
    EXPECT_LT((box - size).norm(), kRounding) << name;
  }
}

TEST(Shapes, BarHasCellsAsCubicAsItsSizeAllows) {
  const SurfaceMesh mesh = make_shape("bar", 1000, {1, 0.2, 0.1});
  const Eigen::Matrix2Xi E = edges_of(mesh.F);
  double longest = 0, shortest = 1;
  for (const auto& e : E.colwise()) {
    const double l = (mesh.X.col(e[0]) - mesh.X.col(e[1])).norm();
    longest = std::max(longest, l);
    shortest = std::min(shortest, l);
  }
  EXPECT_LT(longest / shortest, 2);
}

TEST(Shapes, TrianglesOfRoundShapesAreWellFormed) {
  for (const std::string name : {"ball", "torus", "handle", "head"}) {
    const SurfaceMesh mesh = make_shape(name, 924);
    double total = 0;
    for (const auto& f : mesh.F.colwise()) {
      const Eigen::Vector3d a = mesh.X.col(f[0]), b = mesh.X.col(f[1]), c = mesh.X.col(f[2]);
      const double lengths2 = (b - a).squaredNorm() + (c - b).squaredNorm() + (a - c).squaredNorm();
      total += 2 * std::sqrt(3.0) * (b - a).cross(c - a).norm() / lengths2;  // 1 for an equilateral triangle
    }
    EXPECT_GT(total / mesh.F.cols(), 0.8) << name;
  }
}

TEST(Shapes, HollowBallHasACavityOfAnEighthOfItsVolume) {
  const SurfaceMesh mesh = make_shape("hollow_ball", 324), ball = make_shape("ball", 162);
  EXPECT_EQ(mesh.X.cols(), 324);
  EXPECT_NEAR(volume(mesh.X, mesh.F), 7.0 / 8 * volume(ball.X, ball.F), 1e-12);
}

TEST(Shapes, RefuseWhatTheyCannotMake) {
  EXPECT_THROW(make_shape("cube", 100), std::runtime_error);
  EXPECT_THROW(make_shape("head", 5), std::runtime_error);
  for (const std::string& name : shape_names())
    EXPECT_THROW(make_shape(name, std::numeric_limits<int>::max()), std::runtime_error) << name;
}
