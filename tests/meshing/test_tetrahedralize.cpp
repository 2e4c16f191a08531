#include <gtest/gtest.h>

#include <filesystem>

#include "meshing/shapes.h"
#include "meshing/surface.h"
#include "meshing/surface_io.h"
#include "meshing/tetrahedralize.h"
#include "tests/meshing/surfaces.h"

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

TEST(Tetrahedralize, FillsEveryShapeAndKeepsItsSurface) {
  for (const auto& name : shape_names()) {
    const SurfaceMesh surface = make_shape(name, 300);
    const TetMesh mesh = tetrahedralize(surface);
    EXPECT_EQ(complaint(mesh, surface), "") << name;
    EXPECT_EQ(mesh.n_surface, surface.X.cols());
    EXPECT_EQ(mesh.F, surface.F);
  }
}

TEST(Tetrahedralize, LeavesCavitiesEmptyAndFillsSolidsInside) {
  const SurfaceMesh ball = make_shape("ball", 162);
  const SurfaceMesh all =
      join(join(ball, inside_out(scaled(ball, 0.6))), join(scaled(ball, 0.3), shifted(ball, {3, 0, 0})));
  EXPECT_EQ(complaint(tetrahedralize(all), all), "");
}

TEST(Tetrahedralize, KeepsInteriorPointsAsTheNextNodes) {
  const SurfaceMesh surface = make_shape("ball", 162);
  Eigen::Matrix3Xd interior(3, 3);
  interior << 0, 0.31, -0.2,  //
      0.1, 0, 0.4,            //
      0, 0.2, 0.123456789;
  const TetMesh mesh = tetrahedralize(surface, {{}, interior});
  EXPECT_EQ(mesh.X.middleCols(162, 3), interior);
  for (int node = 162; node < 165; ++node) EXPECT_TRUE((mesh.T.array() == node).any()) << node;
}

TEST(Tetrahedralize, SmallerInteriorSizeGivesMoreNodesInside) {
  const SurfaceMesh surface = make_shape("ball", 162);
  const TetMesh coarse = tetrahedralize(surface), fine = tetrahedralize(surface, {0.12, {}});
  EXPECT_GT(fine.X.cols() - 162, 3 * (coarse.X.cols() - 162));
}

TEST(Tetrahedralize, IsReproducible) {
  const SurfaceMesh surface = make_shape("torus", 300);
  const TetMesh a = tetrahedralize(surface), b = tetrahedralize(surface);
  EXPECT_EQ(a.X, b.X);
  EXPECT_EQ(a.T, b.T);
}

TEST(Tetrahedralize, TakesARealMesh) {
  const std::filesystem::path file = std::filesystem::path(MESH_FOLDER) / "liver2.obj";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
  const SurfaceMesh surface = read_surface(file);
  EXPECT_EQ(complaint(tetrahedralize(surface), surface), "");
}

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
