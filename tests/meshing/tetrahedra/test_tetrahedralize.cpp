#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "meshing/base/child_process.h"
#include "meshing/base/geometry.h"
#include "meshing/surface/cut_surface.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"
#include "meshing/tetrahedra/tet_mesh.h"
#include "meshing/tetrahedra/tet_worker.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

std::string complaint(const TetMesh& mesh, const SurfaceMesh& surface) {
  try {
    check_tetrahedra(mesh, surface);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

/// What the worker makes of edges wanted at all vertices, and of the longest wanted anywhere (m).
TetNodes mesh_by_tetgen(const SurfaceMesh& surface, double size, double longest) {
  const TemporaryFolder folder;
  const std::string task = folder.path() / "task", nodes = folder.path() / "nodes";
  write_task(task,
             {surface, Eigen::Matrix3Xd(3, 0), Eigen::VectorXd::Constant(surface.X.cols(), size), longest});
  const ChildResult child = run_child(program_folder() / "tetgen_worker", {"0", "0", task, nodes}, 60);
  if (!child.is_success) throw std::runtime_error(child.ending + ": " + child.output);
  return read_nodes(nodes);
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

TEST(Tetrahedralize, ListsTetrahedraByTheirFirstNodes) {
  const Eigen::RowVectorXi first = tetrahedralize(make_shape("torus", 300)).T.colwise().minCoeff();
  EXPECT_TRUE(std::is_sorted(first.begin(), first.end()));
}

TEST(Tetrahedralize, SmallerInteriorSizeGivesMoreNodesInside) {
  const SurfaceMesh surface = make_shape("ball", 162);
  const TetMesh coarse = tetrahedralize(surface), fine = tetrahedralize(surface, {0.12, {}});
  EXPECT_GT(fine.X.cols() - 162, 3 * (coarse.X.cols() - 162));
}

TEST(Tetrahedralize, SmallerSizeAtTheVerticesGivesMoreNodesInside) {
  const SurfaceMesh surface = make_shape("ball", 162);
  const auto n_inside = [&](double size) {
    TetOptions options;
    options.size = Eigen::VectorXd::Constant(162, size);
    return tetrahedralize(surface, options).X.cols() - 162;
  };
  EXPECT_GT(n_inside(0.15), 3 * n_inside(1));
}

TEST(RunChild, TellsHowTheProgramEndsAndWhatItWrites) {
  const auto shell = [](const std::string& text, double time_limit = 60) {
    return run_child("/bin/sh", {"-c", text}, time_limit);
  };
  const ChildResult good = shell("echo out; echo err >&2");
  EXPECT_TRUE(good.is_success);
  EXPECT_EQ(good.ending, "status 0");
  EXPECT_EQ(good.output, "out\nerr\n");
  const ChildResult failed = shell("exit 3");
  EXPECT_FALSE(failed.is_success);
  EXPECT_EQ(failed.ending, "status 3");
  const ChildResult killed = shell("kill -9 $$");
  EXPECT_FALSE(killed.is_success);
  EXPECT_EQ(killed.ending, "signal 9 (Killed)");
  const ChildResult endless = shell("exec sleep 1000", 1);
  EXPECT_FALSE(endless.is_success);
  EXPECT_EQ(endless.ending, "stopped after 1 s");
  EXPECT_THROW(run_child("/nowhere/program", {}, 1), std::runtime_error);
  const ChildResult busy = run_child("/bin/sh", {"-c", "while :; do :; done"}, 60, 0.1);
  EXPECT_FALSE(busy.is_success);
  EXPECT_EQ(busy.ending, "stopped after 0.1 s of computing");
  EXPECT_TRUE(run_child("/bin/sh", {"-c", "sleep 0.3"}, 60, 0.1).is_success)
      << "it waits, and computes little";
}

TEST(RunChild, BoundsWhatAProgramMayWriteAndAllocate) {
  const ChildResult flood = run_child("/bin/sh", {"-c", "exec yes"}, 60, 0.2);
  EXPECT_EQ(flood.ending, "stopped after 0.2 s of computing");
  EXPECT_EQ(flood.output.size(), 1u << 20);
  const std::string large = "sleep 0.2; head -c 300000000 /dev/zero | tail -c 300000000 | wc -c";
  EXPECT_EQ(run_child("/bin/sh", {"-c", large}, 60).output, "300000000\n");
#ifndef __SANITIZE_ADDRESS__
  EXPECT_NE(run_child("/bin/sh", {"-c", large}, 60, 60, 1e8).output, "300000000\n") << "tail keeps it all";
#endif
  const ChildResult orphan = run_child("/bin/sh", {"-c", "echo here; sleep 1000 & exit 0"}, 60);
  EXPECT_TRUE(orphan.is_success) << "what it leaves behind keeps nobody waiting";
  EXPECT_EQ(orphan.output, "here\n");
}

TEST(TemporaryFolder, OfAKilledProcessGoesAsTheNextIsMade) {
  int told[2];
  ASSERT_EQ(pipe(told), 0);
  const pid_t child = fork();
  if (child == 0) {
    const TemporaryFolder left;
    const std::string path = left.path();
    (void)!write(told[1], path.c_str(), path.size() + 1);
    pause();
  }
  char path[256] = {};
  ASSERT_GT(read(told[0], path, sizeof path - 1), 0);
  const auto age = [&] {
    std::filesystem::last_write_time(path,
                                     std::filesystem::file_time_type::clock::now() - std::chrono::hours(1));
  };
  age();
  { const TemporaryFolder next; }
  EXPECT_TRUE(std::filesystem::exists(path)) << "its process lives";
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  EXPECT_TRUE(std::filesystem::exists(path));
  { const TemporaryFolder next; }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(Tetrahedralize, TakesTheNextMesherWhereOneWritesGarbage) {
  const TemporaryFolder workers;
  // The count of columns, 2^62, is more than any file holds.
  std::ofstream(workers.path() / "gmsh_worker")
      << "#!/bin/sh\nprintf '\\000\\000\\000\\000\\000\\000\\000\\100garbage' >$4\n";
  std::filesystem::permissions(workers.path() / "gmsh_worker", std::filesystem::perms::owner_all);
  std::filesystem::create_symlink(program_folder() / "tetgen_worker", workers.path() / "tetgen_worker");
  TetOptions options;
  options.workers = workers.path();
  TetReport report;
  const SurfaceMesh ball = make_shape("ball", 162);
  EXPECT_EQ(complaint(tetrahedralize(ball, options, &report), ball), "");
  EXPECT_EQ(report.mesher, "tetgen");
  ASSERT_FALSE(report.failures.empty());
  EXPECT_EQ(report.failures[0], "gmsh, Delaunay: what the mesher wrote is damaged or cut");
}

TEST(TemporaryFolder, IsAnotherEachTimeAndGoesWithItsFiles) {
  std::filesystem::path path;
  {
    const TemporaryFolder one, other;
    path = one.path();
    EXPECT_NE(path, other.path());
    std::filesystem::create_directory(path / "folder");
    EXPECT_TRUE(std::filesystem::exists(path / "folder"));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
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

TEST(Tetrahedralize, KeepsInteriorPointsOfEverySolid) {
  const SurfaceMesh ball = make_shape("ball", 162);
  const SurfaceMesh all = join(join(ball, inside_out(scaled(ball, 0.4))), shifted(ball, {3, 0, 0}));
  Eigen::Matrix3Xd interior(3, 2);
  interior << 3.1, 0.7,  //
      0, 0,              //
      0.2, 0;
  const TetMesh mesh = tetrahedralize(all, {{}, interior});
  EXPECT_EQ(mesh.X.middleCols(486, 2), interior);
}

TEST(Tetrahedralize, GoesOnWhenAMesherFails) {
  // a valid CAD part on which gmsh's Delaunay gives up or aborts
  const std::filesystem::path file = std::filesystem::path(MESH_FOLDER) / "fixed_top.ply";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
  const SurfaceMesh surface = read_surface(file);
  TetReport report;
  EXPECT_EQ(complaint(tetrahedralize(surface, {}, &report), surface), "");
  ASSERT_FALSE(report.failures.empty());
  EXPECT_NE(report.failures[0].find("boundary mesh"), std::string::npos) << report.failures[0];
}

TEST(Tetrahedralize, ReportsOfThisSurfaceAlone) {
  TetReport report{"another", {"of another surface"}};
  tetrahedralize(make_shape("ball", 42), {}, &report);
  EXPECT_EQ(report.mesher, "gmsh, Delaunay");
  EXPECT_TRUE(report.failures.empty()) << report.failures[0];
}

TEST(TetgenWorker, NoTetrahedronIsLargerThanARegularOneOfTheLongestEdge) {
  const SurfaceMesh ball = make_shape("ball", 642);
  // by their size at the vertices alone they would be 1.3 and 1.6 times as large
  for (const auto& [longest, size] : {std::pair{0.4, 0.3}, {0.5, 0.5}}) {
    const TetNodes nodes = mesh_by_tetgen(ball, size, longest);
    const double regular = std::pow(longest, 3) / (6 * std::sqrt(2.0));
    double largest = 0;
    for (const auto& tet : nodes.T.colwise()) largest = std::max(largest, tet_volume(nodes.X, tet));
    EXPECT_LE(largest, regular * (1 + 1e-6)) << longest;
    EXPECT_GT(largest, 0.8 * regular) << longest << ": no smaller than needed";
  }
}

TEST(TetgenWorker, KeepsPointsInABodyWhoseEdgesMayBeLong) {
  const SurfaceMesh ball = make_shape("ball", 162);
  Eigen::Matrix3Xd interior = make_shape("ball", 42).X;
  interior *= 0.5;
  const TemporaryFolder folder;
  const std::string task = folder.path() / "task", file = folder.path() / "nodes";
  write_task(task, {ball, interior, Eigen::VectorXd::Constant(162, 4), 0});
  const ChildResult child = run_child(program_folder() / "tetgen_worker", {"0", "0", task, file}, 60, 5);
  ASSERT_TRUE(child.is_success) << child.ending;
  const TetNodes nodes = read_nodes(file);
  EXPECT_EQ(nodes.X.middleCols(162, 42), interior);
  EXPECT_LT(nodes.X.cols(), 162 + 42 + 20) << "few are added";
}

TEST(TetgenWorker, FillsABodyAlikeAtEveryScale) {
  const auto n_tetrahedra = [](double scale) {  // a power of two: all coordinates round alike
    return mesh_by_tetgen(scaled(make_shape("ball", 162), scale), 0.3 * scale, 0.4 * scale).T.cols();
  };
  EXPECT_EQ(n_tetrahedra(0x1p-10), n_tetrahedra(1)) << "a body of a millimetre and one of a metre";
}

TEST(Tetrahedralize, RefusesCrossingsWithTheirPlaces) {
  const SurfaceMesh ball = make_shape("ball", 162);
  try {
    tetrahedralize(join(ball, shifted(ball, {1, 0.1, 0.05})));
    FAIL() << "overlapping balls were filled";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("pairs of triangles intersect: 21 and 320 at vertex 18"),
              std::string::npos)
        << error.what();
  }
}

TEST(Tetrahedralize, StopsAMesherThatHangsAndTakesTheNext) {
  const TemporaryFolder workers;
  std::ofstream(workers.path() / "gmsh_worker") << "#!/bin/sh\nexec sleep 1000\n";
  std::filesystem::permissions(workers.path() / "gmsh_worker", std::filesystem::perms::owner_all);
  std::filesystem::create_symlink(program_folder() / "tetgen_worker", workers.path() / "tetgen_worker");
  const SurfaceMesh ball = make_shape("ball", 162);
  TetOptions options;
  options.workers = workers.path();
  options.time_limit = 0.5;
  TetReport report;
  EXPECT_EQ(complaint(tetrahedralize(ball, options, &report), ball), "");
  EXPECT_EQ(report.mesher, "tetgen");
  EXPECT_EQ(report.failures, std::vector<std::string>{"gmsh, Delaunay: stopped after 5 s"})
      << "its second settings are not tried";
}

TEST(Tetrahedralize, GivesAMesherTimeByTheTrianglesAndPoints) {
  EXPECT_GT(time_limit(12, 0), 4) << "even a small body may take seconds";
  EXPECT_NEAR(time_limit(30000, 0) - time_limit(10000, 0), 2 * (time_limit(20000, 0) - time_limit(10000, 0)),
              1e-9);
  EXPECT_GT(time_limit(10000, 20000), time_limit(10000, 0));
}

/// What is said of a surface that no mesher fills in 10 ms.
std::string refusal_of(const SurfaceMesh& surface) {
  TetOptions options;
  options.time_limit = 0.01;
  try {
    tetrahedralize(surface, options);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(Tetrahedralize, NamesEveryMesherWhenNoneEndsInTime) {
  const std::string refusal = refusal_of(make_shape("ball", 2562));
  for (const char* part :
       {"gmsh, HXT: stopped after", "gmsh, Delaunay: stopped after", "tetgen: stopped after"})
    EXPECT_NE(refusal.find(part), std::string::npos) << refusal;
}

/// A folder of meshers that fail.
void write_workers(const std::filesystem::path& folder, const std::string& gmsh, const std::string& tetgen) {
  for (const auto& [name, does] : {std::pair("gmsh_worker", gmsh), {"tetgen_worker", tetgen}}) {
    std::ofstream(folder / name) << "#!/bin/sh\n" << does << '\n';
    std::filesystem::permissions(folder / name, std::filesystem::perms::owner_all);
  }
}

/// The meshers that fail on a ball, in their order.
std::vector<std::string> failures_on(const SurfaceMesh& ball, const std::string& gmsh,
                                     const std::string& tetgen) {
  const TemporaryFolder workers;
  write_workers(workers.path(), gmsh, tetgen);
  TetOptions options;
  options.workers = workers.path();
  options.time_limit = 0.2;
  TetReport report;
  EXPECT_THROW(tetrahedralize(ball, options, &report), std::runtime_error);
  return report.failures;
}

SurfaceMesh cut_ball() {
  const SurfaceMesh ball = make_shape("ball", 162);
  return cut_surface(ball, longest_edges(ball) / 2, 642);
}

TEST(Tetrahedralize, LeavesTheSlowMesherToSurfacesThatAreNotCut) {
  EXPECT_EQ(failures_on(cut_ball(), "exit 1", "exit 3"),
            (std::vector<std::string>{"gmsh, Delaunay: status 1", "tetgen: status 3"}));
  EXPECT_EQ(
      failures_on(make_shape("ball", 162), "exit 1", "exit 3"),
      (std::vector<std::string>{"gmsh, Delaunay: status 1", "tetgen: status 3", "gmsh, HXT: status 1"}));
}

TEST(Tetrahedralize, BringsFacetsCloserOnlyWhereSomeOverlap) {
  const std::vector<std::string> failures =
      failures_on(cut_ball(), "echo Error: overlapping facets; exit 1", "exit 3");
  ASSERT_EQ(failures.size(), 3);
  EXPECT_EQ(failures[1],
            "gmsh, Delaunay, facets as close as 0.001 degrees: status 1; Error: overlapping facets");
}

TEST(Tetrahedralize, TriesTheOtherMesherFirstWhereItIsAskedTo) {
  TetOptions options;
  options.is_tetgen_first = true;
  TetReport report;
  const SurfaceMesh ball = make_shape("ball", 162);
  EXPECT_EQ(complaint(tetrahedralize(ball, options, &report), ball), "");
  EXPECT_EQ(report.mesher, "tetgen");
  EXPECT_TRUE(report.failures.empty());
}

TEST(Tetrahedralize, TellsWhetherTimeWasOverWhereNoneFillsASurface) {
  const TemporaryFolder workers;
  TetOptions options;
  options.workers = workers.path();
  options.time_limit = 0.2;
  write_workers(workers.path(), "while :; do :; done", "exit 3");
  EXPECT_THROW(tetrahedralize(cut_ball(), options), OutOfTime);
  write_workers(workers.path(), "exit 1", "exit 3");
  try {
    tetrahedralize(cut_ball(), options);
    FAIL() << "filled without a mesher";
  } catch (const std::runtime_error& error) {
    EXPECT_FALSE(dynamic_cast<const OutOfTime*>(&error)) << error.what();
  }
}
