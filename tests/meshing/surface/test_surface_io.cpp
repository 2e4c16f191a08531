#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>

#include "meshing/base/random.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"
#include "tests/meshing/surface_files.h"

using namespace testbed::meshing;
namespace fs = std::filesystem;

namespace {

const fs::path kMeshFolder = MESH_FOLDER;
constexpr double kRounding = 1e-12;

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

TEST(SurfaceIo, ReadsEveryWholeNumberOfBinaryPlyToItsLimits) {
  // vertex v of one triangle is at (v, v^2, least of the type), so that no index can be taken for another
  const auto expect_indices = [](const std::vector<std::string>& names, auto greatest) {
    using Index = decltype(greatest);
    const int n = static_cast<int>(std::min<double>(greatest, 70000)) + 1;
    const std::vector<int> corners{0, n / 2 + 1, n - 1};
    const Index least = std::numeric_limits<Index>::min();
    for (const std::string& name : names) {
      std::string bytes = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(n) +
                          "\nproperty double x\nproperty double y\nproperty " + name +
                          " z\nelement face 1\nproperty list uchar " + name + " vertex_indices\nend_header\n";
      for (int v = 0; v < n; ++v) {
        append<double>(bytes, v, false);
        append<double>(bytes, double(v) * v, false);
        append(bytes, least, false);
      }
      append<std::uint8_t>(bytes, 3, false);
      for (int v : corners) append(bytes, static_cast<Index>(v), false);
      const SurfaceMesh mesh = read_surface(file_of("index.ply", bytes));
      for (int c = 0; c < 3; ++c)
        EXPECT_EQ(mesh.X.col(mesh.F(c, 0)),
                  Eigen::Vector3d(corners[c], double(corners[c]) * corners[c], double(least)))
            << name;
    }
  };
  expect_indices({"char", "int8"}, std::numeric_limits<std::int8_t>::max());
  expect_indices({"uchar", "uint8"}, std::numeric_limits<std::uint8_t>::max());
  expect_indices({"short", "int16"}, std::numeric_limits<std::int16_t>::max());
  expect_indices({"ushort", "uint16"}, std::numeric_limits<std::uint16_t>::max());
  expect_indices({"int", "int32"}, std::numeric_limits<std::int32_t>::max());
  expect_indices({"uint", "uint32"}, std::numeric_limits<std::uint32_t>::max());
}

TEST(SurfaceIo, ReadsBinaryStlWhateverItsHeaderSays) {
  SurfaceMesh mesh = make_shape("head", 100);
  mesh.X = mesh.X.cast<float>().cast<double>().eval();
  std::string bytes = binary_stl_of(mesh, "solid although binary");
  ReadReport report;
  const SurfaceMesh read = read_surface(file_of("binary.stl", bytes), &report);
  EXPECT_EQ(report.n_merged, 3 * mesh.F.cols() - mesh.X.cols());
  EXPECT_NO_THROW(check_closed(read, "binary.stl"));
  for (int f = 0; f < mesh.F.cols(); ++f)
    for (int c = 0; c < 3; ++c) EXPECT_EQ(read.X.col(read.F(c, f)), mesh.X.col(mesh.F(c, f)));
  const std::string size = std::to_string(bytes.size());
  bytes.pop_back();
  const std::string said = complaint(file_of("cut.stl", bytes));
  EXPECT_NE(said.find(" bytes, expected " + size + " for "), std::string::npos) << said;
}

TEST(SurfaceIo, ReadsTextStl) {
  const SurfaceMesh mesh = make_shape("ball", 42);
  const std::string text = text_stl_of(mesh);
  const SurfaceMesh read = read_surface(file_of("text.stl", text));
  EXPECT_NO_THROW(check_closed(read, "text.stl"));
  for (int f = 0; f < mesh.F.cols(); ++f)
    for (int c = 0; c < 3; ++c) EXPECT_EQ(read.X.col(read.F(c, f)), mesh.X.col(mesh.F(c, f)));
  const std::string cut = text.substr(0, text.rfind("endfacet"));
  EXPECT_NE(complaint(file_of("cut_text.stl", cut)).find("end of file, expected endfacet"),
            std::string::npos);
  EXPECT_NE(complaint(file_of("two_corners.stl", "solid\nfacet\nvertex 0 0 0\nvertex 1 0 0\nendfacet\n"))
                .find("two_corners.stl:5: facet with 2 corner(s), expected 3"),
            std::string::npos);
}

TEST(SurfaceIo, ReadsEveryNameOfPlysFaces) {
  for (const std::string name : {"vertex_indices", "vertex_index"}) {
    const SurfaceMesh mesh =
        read_surface(file_of("faces.ply",
                             "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                             "property float z\nelement face 1\nproperty list uchar int other\n"
                             "property list uchar int " +
                                 name + "\nend_header\n0 0 0 2 0 0 0 1 0\n4 0 0 0 0 3 0 1 2\n"));
    EXPECT_EQ(mesh.F, Eigen::Vector3i(0, 1, 2)) << name;
    EXPECT_NEAR(area(mesh.X, mesh.F), 1, kRounding) << name;
  }
}

TEST(SurfaceIo, ReadsEveryHeaderOfOff) {
  // texture coordinates, colours and normals follow the position
  for (const std::string header : {"OFF", "STOFF", "COFF", "NOFF", "STCNOFF"}) {
    const SurfaceMesh mesh = read_surface(
        file_of("header.off", header + "\n3 1 0\n0 0 0 5 6 7 8\n2 0 0 5 6 7 8\n0 1 0 5 6 7 8\n3 0 1 2\n"));
    EXPECT_NEAR(area(mesh.X, mesh.F), 1, kRounding) << header;
  }
  const std::string said = complaint(file_of("header.off", "4OFF\n3 1 0\n"));
  EXPECT_NE(said.find("'4OFF', expected OFF"), std::string::npos) << said;
}

TEST(SurfaceIo, ReadsObjAsUsersWriteIt) {
  const SurfaceMesh mesh =
      read_surface(file_of("odd.obj",
                           "\xEF\xBB\xBF# comment\r\nmtllib a.mtl\r\no Größe\r\n"
                           "v 0 0 0 0.1 0.2 nan\r\nv +1 0 0\r\nvt 0 0\r\nv 0 1e0 0\r\nv 0 0 1\r\n"
                           "f 1/1 3/1/1 2//1\r\nf -4 -3 \\\r\n -1\r\nf 1 4 3\r\nf 2 3 4"));
  EXPECT_EQ(mesh.X.cols(), 4);
  EXPECT_NO_THROW(check_closed(mesh, "odd.obj"));
  EXPECT_NEAR(volume(mesh.X, mesh.F), 1.0 / 6, kRounding);
}

TEST(SurfaceIo, CutsPolygonsThatAreNotConvexInsideTheirOutline) {
  // an arrow head: area 0.5 inside the outline, a fan from the first corner would cover more
  for (const std::string corners : {"1 2 3 0", "2 3 0 1", "3 0 1 2", "0 1 2 3"}) {
    const SurfaceMesh mesh =
        read_surface(file_of("arrow.off", "OFF 4 1 0\n0 0 0\n1 -1 0\n0 1 0\n-1 -1 0\n4 " + corners + "\n"));
    EXPECT_NEAR(area(mesh.X, mesh.F), 1, kRounding) << corners;
  }
}

TEST(SurfaceIo, ReadsTheSurfaceOfVtkFilesAndNothingElse) {
  // a pyramid of a quadrilateral, triangles and a polygon; then a line, a tetrahedron and a spare point
  const std::string points = "9 9 9 0 0 0 1 0 0 1 1 0 0 1 0 0 0 1";
  const SurfaceMesh pyramid =
      read_surface(file_of("pyramid.vtu", vtu_of("1 4 3 2 1 2 5 2 3 5 3 4 5 4 1 5 0 1 0 1 2 4",
                                                 "4 7 10 13 16 18 22", "9 5 5 7 5 3 10", points)));
  EXPECT_EQ(pyramid.X.cols(), 5);
  EXPECT_EQ(pyramid.F.cols(), 6);
  EXPECT_NO_THROW(check_closed(pyramid, "pyramid.vtu"));
  EXPECT_NEAR(volume(pyramid.X, pyramid.F), 1.0 / 3, kRounding);
  const SurfaceMesh tetrahedron =
      read_surface(file_of("tet.vtp", vtp_of("0 2 1 0 1 3 1 2 3 0 3 2", "3 6 9 12")));
  EXPECT_NO_THROW(check_closed(tetrahedron, "tet.vtp"));
  EXPECT_NEAR(volume(tetrahedron.X, tetrahedron.F), 1.0 / 6, kRounding);
}

TEST(SurfaceIo, ErrorsInVtkFilesNameCellValueAndWhatIsExpected) {
  const std::string four = "0 2 1 0 1 3 1 2 3 0 3 2", ends = "3 6 9 12";
  const std::string types = "expected 5, 7 or 9 (triangle, polygon, quadrilateral)";
  const std::vector<std::tuple<std::string, std::string, std::string>> cases = {
      {"a.vtu", vtu_of("0 2 1 0 1 3 1 2 4 0 3 2", ends, "5 5 5 5"), "cell 2 has point 4, expected 0 to 3"},
      {"b.vtu", vtu_of("0 2 1 0 -1 3 1 2 3 0 3 2", ends, "5 5 5 5"), "cell 1 has point -1, expected 0 to 3"},
      {"c.vtu", vtu_of("4294967296 2 1", "3", "5"), "cell 0 has point 4294967296, expected 0 to 3"},
      {"d.vtu", vtu_of(four, ends, "5 5 255 5"), "cell 2 has type 255, " + types},
      {"e.vtu", vtu_of("0 1 2 3", "4", "8"), "cell 0 has type 8, " + types},
      {"f.vtu", vtu_of("0 1 2", "0 3", "7 5"), "cell 0 has 0 corner(s), expected at least 3"},
      {"g.vtu", vtu_of("0 1 2 3", "3 4", "5 7"), "cell 1 has 1 corner(s), expected at least 3"},
      {"h.vtu", vtu_of("0 1 0 1 2", "2 5", "5 5"), "cell 0 has 2 corner(s), expected 3"},
      {"i.vtu", vtu_of("0 1 2 3", "4", "5"), "cell 0 has 4 corner(s), expected 3"},
      {"j.vtu", vtu_of("0 1 2", "3", "9"), "cell 0 has 3 corner(s), expected 4"},
      {"k.vtu", vtu_of(four, "3 6 9", "5 5 5 5"), "cannot be read"},
      {"l.vtu", vtu_of(four, "3 2 9 12", "5 5 5 5"), "cannot be read"},
      {"m.vtu", vtu_of(four, "3 6 9 15", "5 5 5 5"), "cannot be read"},
      {"n.vtu", vtu_of("", "", ""), "no triangles, expected a surface"},
      {"o.vtp", vtp_of("0 2 1 0 1 4", "3 6"), "polygon 1 has point 4, expected 0 to 3"},
      {"p.vtp", vtp_of("0 2 -3", "3"), "polygon 0 has point -3, expected 0 to 3"},
      {"q.vtp", vtp_of("0 1 2", "3 3"), "polygon 1 has 0 corner(s), expected at least 3"},
      {"r.vtp", vtp_of("0 0 1 2", "1 4"), "polygon 0 has 1 corner(s), expected at least 3"},
      {"s.vtp", vtp_of("0 1 2 0 1", "3 5"), "polygon 1 has 2 corner(s), expected at least 3"},
      {"t.vtp", vtp_of("0 1 2", "3", "Strips"), "1 triangle strips, expected polygons"}};
  for (const auto& [name, text, expected] : cases)
    EXPECT_NE(complaint(file_of(name, text)).find(name + ": " + expected), std::string::npos)
        << complaint(file_of(name, text));
}

TEST(SurfaceIo, VtkFilesThatCrashOrOccupyItsReaderEndInOneLine) {
  const auto replaced = [](std::string text, const std::string& old, const std::string& by) {
    const size_t at = text.find(old);
    EXPECT_NE(at, std::string::npos) << old;
    return text.replace(at, old.size(), by);
  };
  const std::string four = "0 2 1 0 1 3 1 2 3 0 3 2", ends = "3 6 9 12";
  const std::string vtu = vtu_of(four, ends, "5 5 5 5"), vtp = vtp_of(four, ends);
  std::string nested;
  for (int n = 0; n < 500000; ++n) nested += "<a>";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"cells.vtu", replaced(vtu, "NumberOfCells=\"4\"", "NumberOfCells=\"-3\"")},
      {"points.vtu", replaced(vtu, "NumberOfPoints=\"4\"", "NumberOfPoints=\"-3\"")},
      {"many.vtu", replaced(vtu, "NumberOfCells=\"4\"", "NumberOfCells=\"4000000000\"")},
      {"components.vtp", replaced(vtp, "NumberOfComponents=\"3\"", "NumberOfComponents=\"4294967295\"")},
      {"polys.vtp", replaced(vtp, "NumberOfPolys=\"4\"", "NumberOfPolys=\"-3\"")},
      {"nested.vtp", "<VTKFile type=\"PolyData\">" + nested}};
  for (const auto& [name, text] : cases) {
    const std::string said = complaint(file_of(name, text));
    EXPECT_NE(said.find(name + ": "), std::string::npos) << said;
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 0) << said;
  }
}

TEST(SurfaceIo, WhatIsNoFileOrHasNoEndIsRefused) {
  EXPECT_NE(complaint("/dev/zero").find("/dev/zero: cannot be read, expected a file"), std::string::npos);
  const fs::path pipe = file_of("pipe.obj", "");
  fs::remove(pipe);
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_NE(complaint(pipe).find("pipe.obj: cannot be read, expected a file"), std::string::npos);
  fs::remove(pipe);
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face ";
  const std::string points = "end_header\n0 0 0 1 0 0 0 1 0\n";
  EXPECT_NE(complaint(file_of("rows.ply", head + "4294967296\n" + points))
                .find("rows.ply: element face 4294967296 with 0 properties"),
            std::string::npos);
  EXPECT_NE(complaint(file_of("less.ply", head + "-1\nproperty list int int vertex_index\n" + points))
                .find("less.ply: element face -1"),
            std::string::npos);
}

TEST(SurfaceIo, RefusesABodySoFarOffThatDoublesHaveNoDigitsForIt) {
  SurfaceMesh ball = make_shape("ball", 42);
  ball.X.array() += 1e6;
  const fs::path file = file_of("far.obj", "");
  write_surface(file, ball);
  EXPECT_EQ(read_surface(file).X, ball.X);
  ball.X.array() += 1e12;
  write_surface(file, ball);
  EXPECT_NE(complaint(file).find("far.obj: lies 1e+12 from the origin at a size of "), std::string::npos)
      << complaint(file);
}

TEST(SurfaceIo, MergesEqualPositionsIntoTheFirst) {
  ReadReport report;
  const SurfaceMesh mesh = read_surface(
      file_of("seam.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 1 1 0\nv -0.0 1 0\nf 1 2 3\nf 4 5 6\n"),
      &report);
  EXPECT_EQ(report.n_merged, 2);
  EXPECT_EQ(mesh.X.cols(), 4);
  EXPECT_EQ(mesh.F.col(1), Eigen::Vector3i(1, 3, 2));
  EXPECT_EQ(report.vertices, (std::vector<int>{0, 1, 2, 1, 3, 2}));
  EXPECT_EQ(report.points[3], Eigen::Vector3d(1, 0, 0));
  EXPECT_EQ(report.triangles[1], Eigen::Vector3i(3, 4, 5));
}

TEST(SurfaceIo, FacesThatTakeTooLongToCutAreRefusedAndLargeRoundOnesAreNot) {
  const auto face_of = [](int n, const auto& point) {
    std::ostringstream text;
    text.precision(17);
    text << "OFF\n" << n << " 1 0\n";
    for (int i = 0; i < n; ++i) text << point(i).transpose() << " 0\n";
    text << n;
    for (int i = 0; i < n; ++i) text << ' ' << i;
    return file_of("face.off", text.str());
  };
  Random random(1);
  const auto anywhere = [&](int) { return Eigen::Vector2d(random.uniform(), random.uniform()); };
  const auto round = [](int i) { return Eigen::Vector2d(std::cos(i * 2e-3), std::sin(i * 2e-3)); };
  EXPECT_NE(complaint(face_of(20000, anywhere)).find("face.off: a face of 20000 corners takes too long"),
            std::string::npos);
  EXPECT_EQ(read_surface(face_of(3000, round)).F.cols(), 2998);
}

TEST(SurfaceIo, FilesOfMoreThanAGigabyteAreRefusedUnread) {
  for (const std::string name : {"zeros.off", "zeros.stl", "zeros.vtp"}) {
    const fs::path file = file_of(name, "");
    fs::resize_file(file, 2000000000);
    EXPECT_NE(complaint(file).find(name + ": 2000000000 bytes, expected at most 1000000000 of a surface"),
              std::string::npos);
    fs::remove(file);
  }
}

TEST(SurfaceIo, ErrorsNameFileLineAndValue) {
  const std::string three_points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  const auto ply_face = [](const std::string& type, const std::string& face) {
    return "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
           "property float z\nelement face 1\nproperty list " +
           type + " " + type + " vertex_index\nend_header\n0 0 0 1 0 0 0 1 0\n" + face + "\n";
  };
  const std::vector<std::tuple<std::string, std::string, std::string>> cases = {
      {"a.obj", "v 0 0 0\nv 1 x 0\n", "a.obj:2: 'x'"},
      {"b.obj", "v 0 0 nan\n", "b.obj:1: 'nan'"},
      {"crlf.obj", "v 0 0 0\r\nv 1 0 0\r\n\r\nv 0 x 0\r\n", "crlf.obj:4: 'x'"},
      {"cr.obj", "v 0 0 0\rv 1 0 0\r\rv 0 x 0\r", "cr.obj:4: 'x'"},
      {"c.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "c.obj:4: vertex 4, expected 1 to 3"},
      {"d.obj", "v 0 0 0\nf 1 1\n", "d.obj:2: face with 2"},
      {"e.obj", "", "e.obj: no triangles"},
      {"f.off", "OFF\n3 1 0\n0 0 0\n", "f.off:3: end of file, expected vertex 1 of 3"},
      {"g.off", "PLY\n", "g.off:1: 'PLY', expected OFF"},
      {"h.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "h.off:6: vertex 3, expected 0 to 2"},
      {"i.stl", std::string(100, '\1'), "i.stl: 100 bytes"},
      {"j.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n",
       "j.ply: end of file"},
      {"k.xyz", "", "k.xyz: extension '.xyz'"},
      // 2^32 + 1, which 32 bits take for 1
      {"l.obj", three_points + "f 4294967297 2 3\n", "l.obj:4: vertex 4294967297, expected 1 to 3"},
      {"m.obj", three_points + "f -4294967297 2 3\n", "m.obj:4: vertex "},
      {"n.ply", ply_face("int", "3 0 1 3"),
       "n.ply: face 0 has vertex 3, expected a whole number from 0 to 2"},
      {"o.ply", ply_face("double", "3 0 1 4294967297"), "o.ply: face 0 has vertex 4294967297, expected"},
      {"p.ply", ply_face("double", "3 0 1 1e300"), "p.ply: face 0 has vertex 1e+300, expected a whole"},
      {"q.ply", ply_face("double", "3 0 nan 1"), "q.ply: face 0 has vertex nan, expected a whole"},
      {"r.ply", ply_face("double", "3 0 1.5 1"), "r.ply: face 0 has vertex 1.5, expected a whole"},
      {"s.ply", ply_face("int", "3 0 -1 1"), "s.ply: face 0 has vertex -1, expected a whole"},
      {"t.ply", ply_face("int", "1e300 0 1 2"), "t.ply: end of file"},
      {"u.ply", ply_face("int", "2.5 0 1 2"), "u.ply: face 0 has 2.5 values of vertex_index, expected"},
      {"v.ply", ply_face("int", "-3 0 1 2"), "v.ply: face 0 has -3 values of vertex_index, expected a count"},
      {"w.ply", ply_face("int", "2 0 1"), "w.ply: face 0 with 2 corner(s), expected at least 3"}};
  for (const auto& [name, text, expected] : cases)
    EXPECT_NE(complaint(file_of(name, text)).find(expected), std::string::npos)
        << complaint(file_of(name, text));
  for (const auto& [name, begin] : std::map<std::string, std::string>{{"long.off", ""},
                                                                      {"long.obj", "v 0 0 "},
                                                                      {"corner.obj", "v 0 0 0\nf "},
                                                                      {"long.ply", "ply\nformat "}})
    EXPECT_LT(complaint(file_of(name, begin + std::string(1000000, '1') + "\nend_header\n")).size(), 500)
        << name;
  EXPECT_NE(complaint("/nowhere/x.obj").find("/nowhere/x.obj: cannot be read"), std::string::npos);
}

TEST(SurfaceIo, ReadsTheSharedMeshesAsTheirListSays) {
  if (!fs::exists(kMeshFolder)) GTEST_SKIP() << "no folder " << kMeshFolder;
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
  constexpr double kPrintedDigits = 5e-4;  // the list gives volumes to four digits
  for (const Row& row : rows) {
    const SurfaceMesh mesh = read_surface(kMeshFolder / row.file);
    EXPECT_EQ(mesh.X.cols(), row.n_vertices) << row.file;
    EXPECT_EQ(mesh.F.cols(), row.n_faces) << row.file;
    EXPECT_NEAR(volume(mesh.X, mesh.F) / row.volume, 1, kPrintedDigits) << row.file;
    EXPECT_NO_THROW(check_closed(mesh, row.file));
  }
}
