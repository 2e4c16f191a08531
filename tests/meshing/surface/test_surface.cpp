#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

constexpr double kRounding = 1e-12;

SurfaceMesh unit_tetrahedron() {
  SurfaceMesh mesh{Eigen::Matrix3Xd(3, 4), Eigen::Matrix3Xi(3, 4)};
  mesh.X << 0, 1, 0, 0,  //
      0, 0, 1, 0,        //
      0, 0, 0, 1;
  mesh.F << 0, 0, 0, 1,  //
      2, 1, 3, 2,        //
      1, 3, 2, 3;
  return mesh;
}

std::string complaint(const SurfaceMesh& mesh) {
  try {
    check_closed(mesh, "mesh");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST(Surface, VolumeAndAreaOfATetrahedron) {
  const SurfaceMesh mesh = unit_tetrahedron();
  EXPECT_NEAR(volume(mesh.X, mesh.F), 1.0 / 6, kRounding);
  EXPECT_NEAR(area(mesh.X, mesh.F), 1.5 + std::sqrt(3.0) / 2, kRounding);
  EXPECT_NEAR(vertex_areas(mesh.X, mesh.F)[0], 0.5, kRounding);
  EXPECT_LT((area_vectors(mesh.X, mesh.F).col(0) - Eigen::Vector3d(0, 0, -0.5)).norm(), kRounding);
  EXPECT_LT(area_vectors(mesh.X, mesh.F).rowwise().sum().norm(), kRounding);
}

TEST(Surface, VolumeDoesNotDependOnTheOrigin) {
  SurfaceMesh mesh = unit_tetrahedron();
  mesh.X.colwise() += Eigen::Vector3d(1e5, -2e5, 3e5);  // rounding of the shifted coordinates is 6e-11
  EXPECT_NEAR(volume(mesh.X, mesh.F), 1.0 / 6, 1e-10);
}

TEST(Surface, IsClosedWhereEveryEdgeIsMetOnceInEachDirection) {
  Eigen::Matrix3Xi F = unit_tetrahedron().F;
  EXPECT_TRUE(is_closed(F));
  EXPECT_FALSE(is_closed(F.leftCols(3)));
  F.col(1).reverseInPlace();
  EXPECT_FALSE(is_closed(F));
}

TEST(Surface, EdgesAreListedOnceInAscendingOrder) {
  Eigen::Matrix2Xi expected(2, 6);
  expected << 0, 0, 0, 1, 1, 2,  //
      1, 2, 3, 2, 3, 3;
  EXPECT_EQ(edges_of(unit_tetrahedron().F), expected);
}

TEST(CheckClosed, AcceptsATetrahedronAndAHollowBall) {
  EXPECT_EQ(complaint(unit_tetrahedron()), "");
  const SurfaceMesh ball = make_shape("ball", 162);
  EXPECT_EQ(complaint(join(ball, inside_out(scaled(ball, 0.5)))), "");
}

TEST(CheckClosed, NamesEveryFault) {
  const SurfaceMesh good = unit_tetrahedron();
  auto expect = [](const SurfaceMesh& mesh, const std::string& fault) {
    EXPECT_NE(complaint(mesh).find(fault), std::string::npos) << "complaint: '" << complaint(mesh) << "'";
  };
  SurfaceMesh open = good;
  open.F.conservativeResize(3, 3);
  expect(open, "have one triangle");

  SurfaceMesh doubled = good;
  doubled.F.conservativeResize(3, 5);
  doubled.F.col(4) = doubled.F.col(0);
  expect(doubled, "more than two triangles");

  SurfaceMesh flipped = good;
  std::swap(flipped.F(0, 0), flipped.F(1, 0));
  expect(flipped, "oriented against each other");

  expect(inside_out(good), "outward");

  SurfaceMesh flat = good;
  flat.X(2, 3) = 0;
  flat.X.col(3) << 0.5, 0.5, 0;
  expect(flat, "have no area");

  SurfaceMesh unused = good;
  unused.X.conservativeResize(3, 5);
  unused.X.col(4).setOnes();
  expect(unused, "belong to no triangle");

  SurfaceMesh not_finite = good;
  not_finite.X(1, 2) = NAN;
  expect(not_finite, "not finite");

  SurfaceMesh pinched = join(good, good);  // two tetrahedra that share vertex 0
  pinched.X.rightCols(4) *= -1;
  pinched.F.rightCols(4).row(0).swap(pinched.F.rightCols(4).row(1));
  for (int& v : pinched.F.reshaped())
    if (v == 4) v = 0;
  pinched.X.col(4) = pinched.X.col(7);
  for (int& v : pinched.F.reshaped())
    if (v == 7) v = 4;
  pinched.X.conservativeResize(3, 7);
  expect(pinched, "separate fans");

  expect({good.X, Eigen::Matrix3Xi(3, 0)}, "no triangles");

  SurfaceMesh beyond = good;
  beyond.F(2, 3) = 4;
  expect(beyond, "vertex indices 0 to 4, expected 0 to 3");
  beyond.F(2, 3) = -1;
  expect(beyond, "vertex indices -1 to 3, expected 0 to 3");
}
