#include <gtest/gtest.h>

#include <filesystem>

#include "meshing/shapes.h"
#include "meshing/surface.h"
#include "meshing/surface_check.h"
#include "meshing/surface_faults.h"
#include "meshing/surface_io.h"
#include "tests/meshing/surfaces.h"

using namespace testbed;
namespace fs = std::filesystem;

namespace {

const fs::path mesh_folder = MESH_FOLDER;

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

std::string verdict_after_repair(const fs::path& file) {
  RepairReport done;
  std::string all;
  for (const std::string& problem : report_surface(repair(read_surface(file), done), 0).problems)
    all += problem + "; ";
  return all;
}

const std::string usable;

}  // namespace

TEST(SurfaceCheck, EverySharedMeshIsUsable) {
  if (!fs::exists(mesh_folder)) GTEST_SKIP() << "no folder " << mesh_folder;
  for (const auto& entry : fs::directory_iterator(mesh_folder))
    if (entry.is_regular_file() && entry.path().extension() != ".md") {
      EXPECT_EQ(verdict(entry.path()), usable) << entry.path();
    }
}

TEST(SurfaceCheck, EveryBadMeshGetsItsVerdict) {
  if (!fs::exists(mesh_folder / "bad")) GTEST_SKIP() << "no folder " << mesh_folder / "bad";
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
      {"blobby-shuffled.off", "3069 edges lie between triangles " + against, usable},
      {"ellipe0.003.off", "1 connected parts are " + outward, usable},
      {"moebius.obj", "112 " + one, one},
      {"frog_eyes.obj", "32 triangles " + flat, usable},
      {"7_8ths_cube.stl", usable, usable},
      {"doubleBall.obj", usable, usable},
      {"soup.stl", "300 " + one, one},
      {"cubevt.obj", usable, usable},
      {"Cray_right.obj", usable, usable},
      {"mpi.off", usable, usable},
      {"sphere_tri_quad_crlf.obj", usable, usable},
      {"negative_indices.obj", usable, usable},
      {"nancolor.obj", usable, usable},
      {"whitespace.off", usable, usable},
      {"sphere_binary_solid_header.stl", usable, usable},
      {"schonhardt.off", "3 edges lie between triangles " + against, usable},
      {"empty.stl", "no triangles", "-"},
      {"handle_normals_reversed_in_file.stl", usable, usable},
      {"no_faces_points_only.off", "no triangles", "-"},
      {"sphere_duplicate_triangle.obj", "1 triangles have the vertices of another", usable},
      {"sphere_flattened.obj", flat, many},
      {"sphere_index_out_of_range.obj", ":170: vertex 168, expected 1 to 162", "-"},
      {"sphere_inside_out.off", "1 connected parts are " + outward, usable},
      {"sphere_nan_vertex.obj", ":8: 'nan', expected a finite number", "-"},
      {"sphere_one_triangle_flipped.obj", "3 edges lie between triangles " + against, usable},
      {"sphere_one_triangle_missing.obj", "3 " + one, "3 " + one},
      {"sphere_truncated.stl", "8101 bytes, expected 16084", "-"},
      {"sphere_unmerged_vertices.obj", usable, usable},
      {"sphere_unreferenced_vertices.obj", "2 vertices belong to no triangle", usable},
      {"sphere_utf8_bom_crlf_names.obj", usable, usable},
      {"sphere_vertex_pulled_through.obj", "10 " + intersect, intersect},
      {"sphere_with_cavity.obj", usable, usable},
      {"sphere_zero_area_triangles.obj", "2 triangles " + flat, usable},
      {"torus_cut_mid_line.obj", "82 " + one, one},
      {"torus_tiny_far_away.obj", usable, usable},
      {"two_spheres_overlapping.obj", "82 " + intersect, intersect},
      {"two_spheres_sharing_a_vertex.obj", "1 vertices " + fans, fans},
      {"zero_bytes.obj", "no triangles", "-"}};
  size_t n_files = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator(mesh_folder / "bad")) ++n_files;
  EXPECT_EQ(rows.size(), n_files) << "every file has its row";
  auto expect = [](const std::string& said, const std::string& expected, const std::string& file) {
    if (expected == usable)
      EXPECT_EQ(said, usable) << file;
    else
      EXPECT_NE(said.find(expected), std::string::npos) << file << ": '" << said << "'";
  };
  for (const Row& row : rows) {
    expect(verdict(mesh_folder / "bad" / row.file), row.before, row.file);
    if (row.after != "-")
      expect(verdict_after_repair(mesh_folder / "bad" / row.file), row.after, row.file + " repaired");
  }
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
