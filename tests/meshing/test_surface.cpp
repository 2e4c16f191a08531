#include <gtest/gtest.h>

#include <filesystem>

#include "meshing/files.h"
#include "meshing/shapes.h"
#include "meshing/surface.h"
#include "meshing/surface_io.h"

namespace testbed {
namespace {

namespace fs = std::filesystem;

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

SurfaceMesh unit_cube() {
  return make_shape("bar", 8, {1, 1, 1});
}

TEST(SurfaceMeasures, CubeHasItsVolumeAndAreaWhereverItLies) {
  SurfaceMesh cube = unit_cube();
  cube.X.colwise() += Eigen::Vector3d(1e4, -2e4, 3e4);
  EXPECT_NEAR(volume(cube.X, cube.F), 1, 1e-10);
  EXPECT_NEAR(area(cube.X, cube.F), 6, 1e-10);
  EXPECT_NEAR(vertex_areas(cube.X, cube.F).sum(), 6, 1e-10);
  EXPECT_EQ(edges_of(cube.F).cols(), 18);
}

TEST(CheckClosed, NamesTheFaultAndWhereItIs) {
  const SurfaceMesh cube = unit_cube();
  const auto message = [](const SurfaceMesh& mesh) { return error_of([&] { check_closed(mesh, "cube"); }); };
  EXPECT_EQ(message(cube), "");

  SurfaceMesh open = cube;
  open.F.conservativeResize(3, 11);
  EXPECT_NE(message(open).find("belongs to 1 triangles"), std::string::npos);

  SurfaceMesh flipped = cube;
  std::swap(flipped.F(0, 3), flipped.F(1, 3));
  EXPECT_NE(message(flipped).find("same direction"), std::string::npos);

  SurfaceMesh inside_out = cube;
  inside_out.F.row(0).swap(inside_out.F.row(1));
  EXPECT_NE(message(inside_out).find("volume is -1"), std::string::npos);

  SurfaceMesh flat = cube;
  flat.X.row(2).setZero();
  EXPECT_NE(message(flat).find("no area"), std::string::npos);

  SurfaceMesh two_at_a_vertex{Eigen::Matrix3Xd(3, 15), Eigen::Matrix3Xi(3, 24)};
  const auto renumber = [](int i) { return i == 0 ? 7 : i + 7; };
  two_at_a_vertex.X.leftCols(8) = cube.X;
  for (int i = 0; i < 8; ++i)
    two_at_a_vertex.X.col(renumber(i)) = cube.X.col(i) + cube.X.col(7) - cube.X.col(0);
  two_at_a_vertex.F << cube.F, cube.F.unaryExpr(renumber);
  EXPECT_NE(message(two_at_a_vertex).find("more than one fan"), std::string::npos);
}

class Formats : public testing::Test {
 protected:
  fs::path write(const std::string& name, const std::string& text) {
    const fs::path file = fs::temp_directory_path() / ("testbed_formats_" + name);
    write_file(file, text);
    return file;
  }
};

const std::string kTetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";

TEST_F(Formats, ObjTakesSlashesNegativeIndicesAndPolygons) {
  const SurfaceMesh mesh =
      read_surface(write("a.obj", "\xef\xbb\xbf# c\r\n" + kTetrahedron +
                                      "vn 0 0 1\nf 1/1/1 3//1 2\nf -4 -3 -1\r\nf 1 4 3\nf 2 3 4\n"));
  EXPECT_NO_THROW(check_closed(mesh, "a"));
  EXPECT_NEAR(volume(mesh.X, mesh.F), 1.0 / 6, 1e-15);
}

TEST_F(Formats, ErrorsNameFileLineValueAndExpectation) {
  const fs::path file = write("b.obj", kTetrahedron + "f 1 2 9\n");
  EXPECT_EQ(error_of([&] { read_surface(file); }),
            file.string() + ":5: found vertex index 9, expected 1 to 4 or -1 to -4 (vertices read so far)");
  const fs::path bad_number = write("c.off", "OFF\n1 0 0\n0 zero 0\n");
  EXPECT_EQ(error_of([&] { read_surface(bad_number); }),
            bad_number.string() + ":3: found 'zero', expected a number");
  const fs::path not_finite = write("d.obj", "v nan 0 0\n");
  EXPECT_NE(error_of([&] { read_surface(not_finite); }).find(":1: found 'nan', expected a finite coordinate"),
            std::string::npos);
  EXPECT_NE(error_of([&] { read_surface("no_such_file.obj"); }).find("cannot be read"), std::string::npos);
}

TEST_F(Formats, OffIsWrittenAndReadBackBitForBit) {
  const SurfaceMesh head = make_shape("head", 100);
  const fs::path file = fs::temp_directory_path() / "testbed_formats_head.off";
  write_off(file, head);
  const SurfaceMesh again = read_surface(file);
  EXPECT_EQ(head.X, again.X);
  EXPECT_EQ(head.F, again.F);
}

// Every good mesh of the collection, with the counts and volume its README states.
struct RealMesh {
  const char* file;
  int n_vertices, n_faces;
  double volume;
};
void PrintTo(const RealMesh& mesh, std::ostream* out) { *out << mesh.file; }

const RealMesh kRealMeshes[] = {{"sphere_small.ply", 162, 320, 4.047},
                                {"thingi_65004.stl", 731, 1466, 1.289e4},
                                {"torus.obj", 800, 1600, 8.745},
                                {"thingi_72214.stl", 830, 1660, 3.03e4},
                                {"handle.off", 1165, 2326, 0.2069},
                                {"liver2.obj", 1170, 2336, 1.147},
                                {"fixed_top.ply", 2374, 4772, 2.645e4},
                                {"spot.ply", 2930, 5856, 0.7183},
                                {"bunny.obj", 3301, 6598, 0.7493},
                                {"decimated-max.obj", 5272, 10540, 5.721e6},
                                {"circle_knot_ascii.stl", 6144, 12288, 1.304e6},
                                {"fandisk.off", 6475, 12946, 0.1404},
                                {"hand_closed.obj", 7993, 15982, 0.02938},
                                {"skull.obj", 49999, 100002, 563.4}};

class RealMeshes : public testing::TestWithParam<RealMesh> {};

TEST_P(RealMeshes, AreReadWithTheirCountsAndVolume) {
  const fs::path file = fs::path(MESH_FOLDER) / GetParam().file;
  if (!fs::exists(file)) GTEST_SKIP() << file << " is not there";
  const SurfaceMesh mesh = read_surface(file);
  EXPECT_NO_THROW(check_closed(mesh, GetParam().file));
  EXPECT_EQ(mesh.X.cols(), GetParam().n_vertices);
  EXPECT_EQ(mesh.F.cols(), GetParam().n_faces);
  EXPECT_NEAR(volume(mesh.X, mesh.F), GetParam().volume, 1e-3 * GetParam().volume);  // printed to four digits
}

INSTANTIATE_TEST_SUITE_P(Files, RealMeshes, testing::ValuesIn(kRealMeshes), [](auto& info) {
  std::string name = info.param.file;
  for (char& c : name)
    if (!std::isalnum(c)) c = '_';
  return name;
});

}  // namespace
}  // namespace testbed
