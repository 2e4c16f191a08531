#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>

#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_check.h"
#include "meshing/surface/surface_faults.h"
#include "meshing/surface/surface_io.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;
namespace fs = std::filesystem;

namespace {

const fs::path kMeshFolder = MESH_FOLDER;

/// What is said of a file: the reader's error, else every problem in one line; empty when it is usable.
std::string verdict(const fs::path& file) {
  try {
    ReadReport read;
    const SurfaceMesh surface = read_surface(file, &read);
    std::string all;
    for (const std::string& problem : report_surface(surface, read.n_merged).problems) all += problem + "; ";
    return all;
  } catch (const std::runtime_error& error) {
    return error.what();
  }
}

std::string problems_of(const SurfaceMesh& surface) {
  std::string all;
  for (const std::string& problem : report_surface(surface, 0).problems) all += problem + "; ";
  return all;
}

/// Pairs of a triangle of one surface and one of the other that intersect, both in general position.
int count_crossings(const SurfaceMesh& one, const SurfaceMesh& other) {
  const auto side = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                       const Eigen::Vector3d& d) { return (b - a).cross(c - a).dot(d - a) > 0; };
  const auto pierces = [&](const SurfaceMesh& edges, int f, const SurfaceMesh& mesh, int g) {
    const Eigen::Vector3d a = mesh.X.col(mesh.F(0, g)), b = mesh.X.col(mesh.F(1, g)),
                          c = mesh.X.col(mesh.F(2, g));
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d p = edges.X.col(edges.F(k, f)), q = edges.X.col(edges.F((k + 1) % 3, f));
      const bool u = side(p, q, a, b);
      if (side(a, b, c, p) != side(a, b, c, q) && u == side(p, q, b, c) && u == side(p, q, c, a)) return true;
    }
    return false;
  };
  int n = 0;
  for (int f = 0; f < one.F.cols(); ++f)
    for (int g = 0; g < other.F.cols(); ++g) n += pierces(one, f, other, g) || pierces(other, g, one, f);
  return n;
}

std::string verdict_after_repair(const fs::path& file) {
  RepairReport done;
  std::string all;
  for (const std::string& problem : report_surface(repair(read_surface(file), done), 0).problems)
    all += problem + "; ";
  return all;
}

const std::string kUsable;

}  // namespace

TEST(SurfaceCheck, EverySharedMeshIsUsable) {
  if (!fs::exists(kMeshFolder)) GTEST_SKIP() << "no folder " << kMeshFolder;
  for (const auto& entry : fs::directory_iterator(kMeshFolder))
    if (entry.is_regular_file() && entry.path().extension() != ".md") {
      EXPECT_EQ(verdict(entry.path()), kUsable) << entry.path();
    }
}

TEST(SurfaceCheck, EveryBadMeshGetsItsVerdict) {
  if (!fs::exists(kMeshFolder / "bad")) GTEST_SKIP() << "no folder " << kMeshFolder / "bad";
  struct Row {
    std::string file, before,
        after;  ///< part of the verdict as read and after repair; "-" when it cannot be read
  };
  const std::string intersect = "pairs of triangles intersect", one = "edges have one triangle",
                    many = "edges have more than two triangles", fans = "join separate fans",
                    against = "oriented against each other", outward = "not oriented outward",
                    flat = "have no area";
  const std::vector<Row> rows = {
      {"demosthenes-low-res.obj", "67 " + one, "67 " + one},
      {"idler_riser.STL", "44 " + one, "44 " + one},
      {"shared.STL", "1 " + many, "1 " + many},
      {"hourglass_ico.obj", "1 vertices " + fans, fans},
      {"dragon.obj", "102 " + many, many},
      {"brucewick.obj", "5 " + intersect, intersect},
      {"elk.off", "7 " + intersect, intersect},
      {"blobby-shuffled.off", "3069 edges lie between triangles " + against, kUsable},
      {"ellipe0.003.off", "1 connected parts are " + outward, kUsable},
      {"moebius.obj", "112 " + one, one},
      {"frog_eyes.obj", "32 triangles " + flat, kUsable},
      {"7_8ths_cube.stl", kUsable, kUsable},
      {"doubleBall.obj", kUsable, kUsable},
      {"soup.stl", "300 " + one, one},
      {"__tracked_surface.stl", "448 " + many, many},
      {"cubevt.obj", kUsable, kUsable},
      {"Cray_right.obj", kUsable, kUsable},
      {"mpi.off", kUsable, kUsable},
      {"sphere_tri_quad_crlf.obj", kUsable, kUsable},
      {"negative_indices.obj", kUsable, kUsable},
      {"nancolor.obj", kUsable, kUsable},
      {"whitespace.off", kUsable, kUsable},
      {"sphere_binary_solid_header.stl", kUsable, kUsable},
      {"schonhardt.off", "3 edges lie between triangles " + against, kUsable},
      {"empty.stl", "no triangles", "-"},
      {"handle_normals_reversed_in_file.stl", kUsable, kUsable},
      {"no_faces_points_only.off", "no triangles", "-"},
      {"sphere_duplicate_triangle.obj", "1 triangles have the vertices of another", kUsable},
      {"sphere_flattened.obj", flat, many},
      {"sphere_index_out_of_range.obj", ":170: vertex 168, expected 1 to 162", "-"},
      {"sphere_inside_out.off", "1 connected parts are " + outward, kUsable},
      {"sphere_nan_vertex.obj", ":8: 'nan', expected a finite number", "-"},
      {"sphere_one_triangle_flipped.obj", "3 edges lie between triangles " + against, kUsable},
      {"sphere_one_triangle_missing.obj", "3 " + one, "3 " + one},
      {"sphere_truncated.stl", "8101 bytes, expected 16084", "-"},
      {"sphere_unmerged_vertices.obj", kUsable, kUsable},
      {"sphere_unreferenced_vertices.obj", "2 vertices belong to no triangle", kUsable},
      {"sphere_utf8_bom_crlf_names.obj", kUsable, kUsable},
      {"sphere_vertex_pulled_through.obj", "10 " + intersect, intersect},
      {"sphere_with_cavity.obj", kUsable, kUsable},
      {"sphere_zero_area_triangles.obj", "2 triangles " + flat, kUsable},
      {"torus_cut_mid_line.obj", "82 " + one, one},
      {"torus_tiny_far_away.obj", kUsable, kUsable},
      {"two_spheres_overlapping.obj", "82 " + intersect, intersect},
      {"two_spheres_sharing_a_vertex.obj", "1 vertices " + fans, fans},
      {"zero_bytes.obj", "no triangles", "-"}};
  size_t n_files = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(kMeshFolder / "bad")) ++n_files;
  EXPECT_EQ(rows.size(), n_files) << "every file has its row";
  auto expect = [](const std::string& said, const std::string& expected, const std::string& file) {
    if (expected == kUsable)
      EXPECT_EQ(said, kUsable) << file;
    else
      EXPECT_NE(said.find(expected), std::string::npos) << file << ": '" << said << "'";
  };
  for (const Row& row : rows) {
    expect(verdict(kMeshFolder / "bad" / row.file), row.before, row.file);
    if (row.after != "-")
      expect(verdict_after_repair(kMeshFolder / "bad" / row.file), row.after, row.file + " repaired");
  }
}

TEST(SurfaceCheck, EveryFaultOfAMeshIsNamedAndMendedWhereItCanBe) {
  const std::string one = "edges have one triangle", many = "edges have more than two triangles",
                    fans = "vertices join separate fans", against = "edges lie between triangles oriented",
                    outward = "connected parts are not oriented outward", flat = "triangles have no area",
                    cross = "pairs of triangles intersect";
  const SurfaceMesh ball = make_shape("ball", 162), other = shifted(ball, {1.1, 0.13, 0.07});
  SurfaceMesh open = ball;
  open.F.conservativeResize(3, 319);
  SurfaceMesh flipped = ball, mixed = ball;
  flipped.F.col(7).reverseInPlace();
  for (int f = 0; f < 320; ++f)
    if (f * f % 7 == 4) mixed.F.col(f).reverseInPlace();
  SurfaceMesh soup{ball.X(Eigen::all, ball.F.reshaped()), ball.F};
  for (int i = 0; i < 960; ++i) soup.F(i % 3, i / 3) = i;
  const int touched = static_cast<int>(
      ((ball.X.colwise() + ball.X.col(9)).colwise().norm().array() < 1e-9)
          .cast<int>()
          .matrix()
          .dot(Eigen::RowVectorXi::LinSpaced(162, 0, 161)));  // the vertex opposite to vertex 9
  const SurfaceMesh kiss = welded(join(ball, shifted(ball, 2 * ball.X.col(9))), 9, 162 + touched);
  SurfaceMesh hinge{Eigen::Matrix3Xd(3, 6), Eigen::Matrix3Xi(3, 8)};  // two tetrahedra with a common edge
  hinge.X << 0, 1, 0, 0, 0, 0, 0, 0, 1, 0, -1, 0, 0, 0, 0, 1, 0, -1;
  hinge.F << 0, 0, 0, 1, 0, 0, 0, 1,  //
      2, 1, 3, 2, 4, 1, 5, 4,         //
      1, 3, 2, 3, 1, 5, 4, 5;
  SurfaceMesh split = with_vertex({hinge.X.leftCols(4), hinge.F.leftCols(4)}, {0, 0.5, 0});
  split.F.col(0) << 0, 4, 1;
  split = with_triangle(with_triangle(split, {4, 2, 1}), {0, 2, 4});
  SurfaceMesh pulled = ball;
  pulled.X.col(9) *= -1.5;
  struct Row {
    const char* name;
    SurfaceMesh mesh;
    std::string before, after;
  };
  const std::vector<Row> rows = {
      {"ball", ball, kUsable, kUsable},
      {"ball with a cavity", join(ball, inside_out(scaled(ball, 0.5))), kUsable, kUsable},
      {"torus tiny and far away", shifted(scaled(make_shape("torus", 300), 1e-4), {10, 20, 30}), kUsable,
       kUsable},
      {"triangle missing", open, "3 " + one, "3 " + one},
      {"triangle flipped", flipped, "3 " + against, kUsable},
      {"triangles mixed", mixed, against, kUsable},
      {"inside out", inside_out(ball), "1 " + outward, kUsable},
      {"solid in a solid", join(ball, scaled(ball, 0.5)), "1 " + outward, kUsable},
      {"triangle twice", with_triangle(ball, ball.F.col(5)), "1 triangles have the vertices of another",
       kUsable},
      {"vertices unused", with_vertex(with_vertex(ball, {9, 9, 9}), {8, 8, 8}),
       "2 vertices belong to no triangle", kUsable},
      {"triangle with a vertex twice", with_triangle(ball, {3, 3, 4}), "1 " + flat, kUsable},
      {"triangle with its corners in a line", split, "1 " + flat, "1 " + flat},
      {"triangles apart", soup, "960 " + one, "960 " + one},
      {"strip with one side", moebius_strip(20), "40 " + one, "40 " + one},
      {"triangle too many", with_triangle(with_vertex(ball, {0, 0, 3}), {ball.F(0, 0), ball.F(1, 0), 162}),
       "1 " + many, "1 " + many},
      {"two solids with a common edge", hinge, "1 " + many, "1 " + many},
      {"two solids with a common vertex", kiss, "1 " + fans, "1 " + fans},
      {"two solids that overlap", join(ball, other),
       std::to_string(count_crossings(ball, other)) + " " + cross, cross},
      {"vertex pulled through", pulled, cross, cross}};
  ASSERT_GT(count_crossings(ball, other), 20);
  const auto expect = [](const std::string& said, const std::string& expected, const std::string& name) {
    if (expected == kUsable)
      EXPECT_EQ(said, kUsable) << name;
    else
      EXPECT_NE((" " + said).find(" " + expected), std::string::npos) << name << ": '" << said << "'";
  };
  for (const Row& row : rows) {
    expect(problems_of(row.mesh), row.before, row.name);
    RepairReport done;
    expect(problems_of(repair(row.mesh, done)), row.after, std::string(row.name) + " repaired");
  }
}

TEST(FindFaults, ListsTheirPlaces) {
  using Edges = std::vector<std::pair<int, int>>;
  const SurfaceMesh ball = make_shape("ball", 42);
  const int a = std::min(ball.F(0, 0), ball.F(1, 0)), b = std::max(ball.F(0, 0), ball.F(1, 0));
  const SurfaceFaults fin = find_faults(with_triangle(with_vertex(ball, {0, 0, 3}), {a, b, 42}));
  EXPECT_EQ(fin.crowded_edges, (Edges{{a, b}})) << "three triangles";
  EXPECT_EQ(fin.open_edges, (Edges{{a, 42}, {b, 42}}));
  SurfaceMesh flipped = ball;
  flipped.F.col(11).reverseInPlace();
  Edges around;
  for (int c = 0; c < 3; ++c) around.push_back(std::minmax(ball.F(c, 11), ball.F((c + 1) % 3, 11)));
  std::sort(around.begin(), around.end());
  EXPECT_EQ(find_faults(flipped).disoriented_edges, around);
  EXPECT_EQ(find_faults(with_triangle(ball, ball.F.col(3))).doubled_triangles, std::vector<int>{80});
  EXPECT_EQ(find_faults(with_triangle(ball, {5, 5, 6})).degenerate_triangles, std::vector<int>{80});
  EXPECT_EQ(find_faults(with_vertex(ball, {9, 9, 9})).unused_vertices, std::vector<int>{42});
  EXPECT_EQ(find_faults(join(ball, inside_out(shifted(ball, {3, 0, 0})))).misturned_triangles,
            std::vector<int>{80});
  EXPECT_TRUE(find_faults(ball).none());
}

TEST(SurfaceCheck, MeasuresOfABoxAreThoseOfItsForm) {
  constexpr double kRounding = 1e-12;
  const auto values = report_surface(make_shape("bar", 8, {1, 1, 1}), 3).values;
  EXPECT_EQ(values["merged_vertices"], 3);
  EXPECT_EQ(values["genus"], 0);
  EXPECT_EQ(values["sliver_triangles"], 0);
  EXPECT_NEAR(values["worst_aspect"].get<double>(), 2, kRounding) << "sqrt(2) over sqrt(1/2)";
  EXPECT_NEAR(values["volume"].get<double>(), 1, kRounding);
  EXPECT_NEAR(values["area"].get<double>(), 6, kRounding);
  EXPECT_NEAR(values["edge_shortest"].get<double>(), 1, kRounding);
  EXPECT_NEAR(values["edge_longest"].get<double>(), std::sqrt(2), kRounding);
  EXPECT_NEAR(values["edge_mean"].get<double>(), (2 + std::sqrt(2)) / 3, kRounding);
  EXPECT_EQ(values["box_high"], (std::vector<double>{1, 1, 1}));
  EXPECT_EQ(report_surface(make_shape("bar", 8, {1, 1, 0.009}), 0).values["sliver_triangles"], 8);
  EXPECT_EQ(report_surface(make_shape("bar", 8, {1, 1, 0.011}), 0).values["sliver_triangles"], 0);
}

TEST(SurfaceCheck, ReportsCountsAndMeasures) {
  const SurfaceMesh torus = make_shape("torus", 924);
  const auto values = report_surface(torus, 0).values;
  EXPECT_EQ(values["vertices"], 924);
  EXPECT_EQ(values["faces"], 1848);
  EXPECT_EQ(values["edges"], 2772);
  EXPECT_EQ(values["genus"], 1);
  EXPECT_EQ(values["components"], 1);
  EXPECT_EQ(values["self_intersections"], 0);
  EXPECT_EQ(values["usable"], true);
  EXPECT_DOUBLE_EQ(values["volume"].get<double>(), volume(torus.X, torus.F));
}

TEST(SurfaceCheck, GenusIsThatOfTheTrianglesWhateverVerticesAreUnused) {
  SurfaceMesh torus = make_shape("torus", 300);
  for (double x : {7, 8, 9}) torus = with_vertex(torus, {x, 0, 0});
  EXPECT_EQ(report_surface(torus, 0).values["genus"], 1);
  EXPECT_EQ(report_surface(join(torus, shifted(torus, {20, 0, 0})), 0).values["genus"], 2);
}

TEST(SurfaceCheck, NestedShellsMustAlternate) {
  const SurfaceMesh ball = make_shape("ball", 162), inner = scaled(ball, 0.5);
  EXPECT_TRUE(report_surface(join(ball, inside_out(inner)), 0).problems.empty());
  EXPECT_FALSE(report_surface(join(ball, inner), 0).problems.empty());  // a solid in a solid
}

TEST(Repair, SaysWhatItChanged) {
  const SurfaceMesh ball = make_shape("ball", 42);
  SurfaceMesh bad = join(inside_out(ball), shifted(ball, {3, 0, 0}));
  const int n = static_cast<int>(bad.F.cols());
  bad.F.conservativeResize(3, n + 3);
  bad.F.col(n) << 0, 0, 1;                                                // a vertex twice
  bad.F.col(n + 1) = bad.F.col(n - 1);                                    // the same again
  bad.F.col(n + 2) << bad.F(1, n - 1), bad.F(2, n - 1), bad.F(0, n - 1);  // and turned round, but alike
  bad.X.conservativeResize(3, 85);
  bad.X.col(84) << 9, 9, 9;
  RepairReport done;
  const SurfaceMesh mended = repair(bad, done);
  EXPECT_EQ(done.n_unused_vertices, 1);
  EXPECT_EQ(done.n_degenerate_triangles, 1);
  EXPECT_EQ(done.n_doubled_triangles, 2);
  EXPECT_EQ(done.n_turned_triangles, 80);
  EXPECT_NO_THROW(check_closed(mended, "mended"));
}

TEST(Repair, DropsBothTrianglesOfAFin) {
  SurfaceMesh bad = make_shape("ball", 42);
  const int n = static_cast<int>(bad.F.cols());
  bad.X.conservativeResize(3, 43);
  bad.X.col(42) << 0, 0, 3;
  bad.F.conservativeResize(3, n + 2);
  bad.F.col(n) << 0, 1, 42;
  bad.F.col(n + 1) << 1, 0, 42;
  RepairReport done;
  EXPECT_NO_THROW(check_closed(repair(bad, done), "mended"));
  EXPECT_EQ(done.n_doubled_triangles, 2);
}

TEST(Repair, CountsATriangleThatIsTurnedTwiceAsLeft) {
  const SurfaceMesh ball = make_shape("ball", 42);
  for (int f : {0, 41}) {  // the others are turned to agree with triangle 0, then all outward
    SurfaceMesh bad = ball;
    bad.F.col(f).reverseInPlace();
    RepairReport done;
    EXPECT_NO_THROW(check_closed(repair(bad, done), "mended"));
    EXPECT_EQ(done.n_turned_triangles, 1) << f;
  }
}
