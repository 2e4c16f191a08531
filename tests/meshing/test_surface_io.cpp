#include <gtest/gtest.h>

#include <cstring>
#include <fstream>

#include "meshing/shapes.h"
#include "meshing/surface.h"
#include "meshing/surface_io.h"

using namespace testbed;
namespace fs = std::filesystem;

namespace {

const fs::path mesh_folder = MESH_FOLDER;
constexpr double rounding = 1e-12;

/// A file of the given text in the test's own folder.
fs::path file_of(const std::string& name, const std::string& text) {
  const fs::path file = fs::path(testing::TempDir()) / ("test_surface_io_" + name);
  std::ofstream(file, std::ios::binary) << text;
  return file;
}

std::string complaint(const fs::path& file) {
  try {
    read_surface(file);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

template <class T>
void append(std::string& bytes, T value, bool is_big_endian) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (is_big_endian) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

std::string ply_of(const SurfaceMesh& mesh, bool is_big_endian) {
  std::string bytes =
      std::string("ply\nformat binary_") + (is_big_endian ? "big" : "little") +
      "_endian 1.0\ncomment made\nelement vertex " + std::to_string(mesh.X.cols()) +
      "\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nelement face " +
      std::to_string(mesh.F.cols()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const auto& x : mesh.X.colwise()) {
    for (double value : x) append(bytes, value, is_big_endian);
    append<std::uint8_t>(bytes, 7, is_big_endian);
  }
  for (const auto& f : mesh.F.colwise()) {
    append<std::uint8_t>(bytes, 3, is_big_endian);
    for (int v : f) append(bytes, v, is_big_endian);
  }
  return bytes;
}

}  // namespace

TEST(SurfaceIo, WritesAndReadsEveryBit) {
  const SurfaceMesh mesh = make_shape("head", 500);
  for (const std::string name : {"head.obj", "head.off"}) {
    const fs::path file = file_of(name, "");
    write_surface(file, mesh);
    const SurfaceMesh read = read_surface(file);
    EXPECT_EQ(read.X, mesh.X);
    EXPECT_EQ(read.F, mesh.F);
  }
}

TEST(SurfaceIo, ReadsBothByteOrdersOfPly) {
  const SurfaceMesh mesh = make_shape("ball", 42);
  for (bool is_big_endian : {false, true}) {
    const SurfaceMesh read = read_surface(file_of("ball.ply", ply_of(mesh, is_big_endian)));
    EXPECT_EQ(read.X, mesh.X);
    EXPECT_EQ(read.F, mesh.F);
  }
}

TEST(SurfaceIo, ReadsObjAsUsersWriteIt) {
  const SurfaceMesh mesh =
      read_surface(file_of("odd.obj",
                           "\xEF\xBB\xBF# comment\r\nmtllib a.mtl\r\no Größe\r\n"
                           "v 0 0 0 0.1 0.2 nan\r\nv +1 0 0\r\nvt 0 0\r\nv 0 1e0 0\r\nv 0 0 1\r\n"
                           "f 1/1 3/1/1 2//1\r\nf -4 -3 \\\r\n -1\r\nf 1 4 3\r\nf 2 3 4"));
  EXPECT_EQ(mesh.X.cols(), 4);
  EXPECT_NO_THROW(check_closed(mesh, "odd.obj"));
  EXPECT_NEAR(volume(mesh.X, mesh.F), 1.0 / 6, rounding);
}

TEST(SurfaceIo, CutsPolygonsThatAreNotConvexInsideTheirOutline) {
  // an arrow head: area 0.5 inside the outline, a fan from the first corner would cover more
  const SurfaceMesh mesh =
      read_surface(file_of("arrow.off", "OFF 4 1 0\n0 0 0\n1 -1 0\n0 1 0\n-1 -1 0\n4 1 2 3 0\n"));
  EXPECT_NEAR(area(mesh.X, mesh.F), 1, rounding);
}

TEST(SurfaceIo, MergesEqualPositionsIntoTheFirst) {
  ReadReport report;
  const SurfaceMesh mesh = read_surface(
      file_of("seam.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 1 1 0\nv -0.0 1 0\nf 1 2 3\nf 4 5 6\n"),
      &report);
  EXPECT_EQ(report.n_merged, 2);
  EXPECT_EQ(mesh.X.cols(), 4);
  EXPECT_EQ(mesh.F.col(1), Eigen::Vector3i(1, 3, 2));
}

TEST(SurfaceIo, ErrorsNameFileLineAndValue) {
  const std::vector<std::tuple<std::string, std::string, std::string>> cases = {
      {"a.obj", "v 0 0 0\nv 1 x 0\n", "a.obj:2: 'x'"},
      {"b.obj", "v 0 0 nan\n", "b.obj:1: 'nan'"},
      {"c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "c.obj:4: vertex 4, expected 1 to 3"},
      {"d.obj", "v 0 0 0\nf 1 1\n", "d.obj:2: face with 2"},
      {"e.obj", "", "e.obj: no triangles"},
      {"f.off", "OFF\n3 1 0\n0 0 0\n", "f.off:3: end of file, expected vertex 1 of 3"},
      {"g.off", "PLY\n", "g.off:1: 'PLY', expected OFF"},
      {"h.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "h.off:6: vertex 3, expected 0 to 2"},
      {"i.stl", std::string(100, '\1'), "i.stl: 100 bytes"},
      {"j.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n",
       "j.ply: end of file"},
      {"k.xyz", "", "k.xyz: extension '.xyz'"}};
  for (const auto& [name, text, expected] : cases)
    EXPECT_NE(complaint(file_of(name, text)).find(expected), std::string::npos)
        << complaint(file_of(name, text));
  EXPECT_NE(complaint("/nowhere/x.obj").find("/nowhere/x.obj: cannot be read"), std::string::npos);
}

TEST(SurfaceIo, ReadsTheSharedMeshesAsTheirListSays) {
  if (!fs::exists(mesh_folder)) GTEST_SKIP() << "no folder " << mesh_folder;
  struct Row {
    const char* file;
    int n_vertices, n_faces;
    double volume;
  };
  const std::vector<Row> rows = {{"sphere_small.ply", 162, 320, 4.047},
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
                                 {"small_intestine_20k.off", 10002, 20000, 1.062e6},
                                 {"rocker-arm.obj", 10044, 20088, 0.04251},
                                 {"boot.obj", 19931, 39906, 0.002548},
                                 {"sword.obj", 22293, 44582, 0.0002104},
                                 {"skull.obj", 49999, 100002, 563.4},
                                 {"bunny_hr_x4.ply", 119330, 238656, 0.7455}};
  constexpr double printed_digits = 5e-4;  // the list gives volumes to four digits
  for (const Row& row : rows) {
    const SurfaceMesh mesh = read_surface(mesh_folder / row.file);
    EXPECT_EQ(mesh.X.cols(), row.n_vertices) << row.file;
    EXPECT_EQ(mesh.F.cols(), row.n_faces) << row.file;
    EXPECT_NEAR(volume(mesh.X, mesh.F) / row.volume, 1, printed_digits) << row.file;
    EXPECT_NO_THROW(check_closed(mesh, row.file));
  }
}
