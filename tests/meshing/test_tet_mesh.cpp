#include <gtest/gtest.h>

#include <cmath>

#include "meshing/shapes.h"
#include "meshing/tet_mesh.h"
#include "meshing/tetrahedralize.h"

using namespace testbed;

namespace {

constexpr double rounding = 1e-12;

std::string complaint(const TetMesh& mesh, const SurfaceMesh& surface) {
  try {
    check_tetrahedra(mesh, surface);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST(CheckTetrahedra, SeesEveryFault) {
  const SurfaceMesh surface = make_shape("ball", 42);
  const TetMesh good = tetrahedralize(surface);
  ASSERT_EQ(complaint(good, surface), "");
  auto expect = [&](const TetMesh& mesh, const std::string& fault) {
    EXPECT_NE(complaint(mesh, surface).find(fault), std::string::npos) << complaint(mesh, surface);
  };
  TetMesh bad = good;
  bad.X(0, 7) = std::nextafter(bad.X(0, 7), 2);
  expect(bad, "moved");
  bad = good;
  std::swap(bad.T(0, 3), bad.T(1, 3));
  expect(bad, "tetrahedron 3 has volume");
  bad = good;
  bad.T.conservativeResize(4, bad.T.cols() - 1);
  expect(bad, "of the surface's volume");
  bad = good;
  const Eigen::Vector4i twin = bad.T.col(0);
  bad.T.col(1) = twin;
  expect(bad, "tetrahedra: ");
  bad = good;
  bad.T.resize(4, 0);
  expect(bad, "none");
  // a surface with the same volume and vertices, one edge flipped between two of its triangles
  SurfaceMesh other = surface;
  other.F.col(5) = other.F.col(5).reverse().eval();
  EXPECT_NE(complaint(good, other), "");
}

TEST(TetVolume, OfTheUnitCornerIsASixth) {
  Eigen::Matrix3Xd X(3, 4);
  X << 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1;
  EXPECT_NEAR(tet_volume(X, {0, 1, 2, 3}), 1.0 / 6, rounding);
  EXPECT_NEAR(tet_volume(X, {0, 2, 1, 3}), -1.0 / 6, rounding);
}

TEST(TetQuality, OfARegularTetrahedronAndOfASliver) {
  Eigen::Matrix3Xd X(3, 4);
  X << 1, 1, -1, -1,  //
      1, -1, 1, -1,   //
      1, -1, -1, 1;
  Eigen::Matrix4Xi T(4, 1);
  T << 0, 1, 3, 2;
  if (tet_volume(X, T.col(0)) < 0) T.col(0).tail<2>().reverseInPlace();
  const TetQuality regular = tet_quality(X, T);
  EXPECT_NEAR(regular.min_dihedral, std::acos(1.0 / 3) * 180 / 3.14159265358979323846, 1e-9);
  EXPECT_NEAR(regular.min_radius_ratio, 1, rounding);
  EXPECT_NEAR(regular.mean_radius_ratio, 1, rounding);
  EXPECT_EQ(regular.n_slivers, 0);
  X.row(2) *= 0.002;  // nearly flat
  const TetQuality flat = tet_quality(X, T);
  EXPECT_LT(flat.min_dihedral, 1);
  EXPECT_LT(flat.min_radius_ratio, 0.01);
  EXPECT_EQ(flat.n_slivers, 1);
}
