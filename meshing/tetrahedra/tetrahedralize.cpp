#include "meshing/tetrahedra/tetrahedralize.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <sstream>
#include <stdexcept>

#include "meshing/base/child_process.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_check.h"
#include "meshing/surface/surface_faults.h"
#include "meshing/tetrahedra/interior_size.h"
#include "meshing/tetrahedra/tet_mesh.h"
#include "meshing/tetrahedra/tet_worker.h"

namespace testbed::meshing {

namespace {

/// A mesher and its settings.
struct Attempt {
  std::string name, worker, algorithm, angle_tolerance;
  std::string cures{};  ///< a word in the failure before it, without which it fails alike
};

/// In the order in which they are tried. HXT comes last: on the long thin triangles of CAD parts, where
/// Delaunay fails, it takes a hundred times as long as tetgen. A cut surface, which may be cut less, goes without.
const std::array<Attempt, 4> kAttempts = {
    {{"gmsh, Delaunay", "gmsh_worker", "1", "0.1"},
     {"gmsh, Delaunay, facets as close as 0.001 degrees", "gmsh_worker", "1", "0.001", "overlap"},
     {"tetgen", "tetgen_worker", "0", "0"},
     {"gmsh, HXT", "gmsh_worker", "10", "0.001"}}};

void refuse_crossings(const SurfaceMesh& surface) {
  const auto pairs = self_intersections(surface);
  if (pairs.empty()) return;
  std::string text;
  for (size_t p = 0; p < std::min<size_t>(pairs.size(), 3); ++p)
    text += (p ? ", " : "") + std::to_string(pairs[p].first) + " and " + std::to_string(pairs[p].second) +
            " at vertex " + vertex_text(surface, surface.F(0, pairs[p].first));
  throw std::runtime_error("surface to tetrahedralize: " + std::to_string(pairs.size()) +
                           " pairs of triangles intersect: " + text);
}

/// The lines of a mesher's output that tell why and where it failed.
std::string messages_in(const std::string& output) {
  constexpr int kMostLines = 6;
  std::istringstream lines(output);
  std::string messages;
  int n = 0;
  for (std::string line; std::getline(lines, line);)
    for (const char* word : {"Error", "rror:", "ssert", "overlap", "intersect"})
      if (line.find(word) != std::string::npos) {
        if (n++ < kMostLines) messages += "; " + line;
        break;
      }
  return messages;
}

/// Tetrahedra by their first nodes: neighbours lie near each other in memory, which spares whoever sums over
/// those of a large body half the time.
Eigen::Matrix4Xi in_order_of_nodes(const Eigen::Matrix4Xi& T) {
  std::vector<int> order(T.cols());
  std::iota(order.begin(), order.end(), 0);
  const Eigen::RowVectorXi first = T.colwise().minCoeff();
  std::stable_sort(order.begin(), order.end(), [&](int s, int t) { return first(s) < first(t); });
  return T(Eigen::all, order);
}

/// @param limit  of the mesher's own computing (s)
TetMesh run_attempt(const Attempt& attempt, const SurfaceMesh& surface, const TetOptions& options,
                    double limit) {
  const TemporaryFolder folder;
  const std::string task = folder.path() / "task", nodes_file = folder.path() / "nodes";
  write_task(task,
             {surface, options.interior, options.size.size() > 0 ? options.size : vertex_spacing(surface),
              options.interior_size.value_or(0)});
  constexpr double kWaiting = 10;  // wall time for each second of computing: other programs need theirs
  const ChildResult child =
      run_child(options.workers / attempt.worker,
                {attempt.algorithm, attempt.angle_tolerance, task, nodes_file}, kWaiting * limit, limit);
  if (child.is_stopped) throw OutOfTime(child.ending);
  if (!child.is_success) throw std::runtime_error(child.ending + messages_in(child.output));
  const TetNodes nodes = read_nodes(nodes_file);
  TetMesh mesh{nodes.X, in_order_of_nodes(nodes.T), surface.F, static_cast<int>(surface.X.cols())};
  try {
    check_tetrahedra(mesh, surface);
    const auto kept = mesh.X.middleCols(mesh.n_surface, options.interior.cols());
    if (kept != options.interior) throw std::runtime_error("tetrahedra: interior points moved");
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(error.what() + messages_in(child.output));
  }
  return mesh;
}

}  // namespace

double time_limit(Eigen::Index n_triangles, Eigen::Index n_points) {
  constexpr double kStart = 5, kTriangle = 1e-3, kPoint = 3e-4;
  return kStart + kTriangle * static_cast<double>(n_triangles) + kPoint * static_cast<double>(n_points);
}

TetMesh tetrahedralize(const SurfaceMesh& surface, const TetOptions& options, TetReport* report) {
  check_closed(surface, "surface to tetrahedralize");
  refuse_crossings(surface);  // meshers may fill overlapping solids one by one without a word
  TetReport own;
  TetReport& said = report ? *report : own;
  said = {};
  const bool is_cut = surface.cuts.F.size() > 0;
  constexpr double kLongestCut = 10;  // s
  const double most = time_limit(surface.F.cols(), options.interior.cols());
  const double limit = options.time_limit.value_or(is_cut ? std::min(kLongestCut, most) : most);
  std::vector<Attempt> attempts(kAttempts.begin(), kAttempts.end() - (is_cut ? 1 : 0));
  if (options.is_tetgen_first)
    std::stable_partition(attempts.begin(), attempts.end(),
                          [](const Attempt& attempt) { return attempt.worker == "tetgen_worker"; });
  bool is_late = false;
  for (const Attempt& attempt : attempts) {
    if (!attempt.cures.empty() && said.failures.back().find(attempt.cures) == std::string::npos) continue;
    try {
      TetMesh mesh = run_attempt(attempt, surface, options, limit);
      said.mesher = attempt.name;
      return mesh;
    } catch (const std::runtime_error& error) {
      said.failures.push_back(attempt.name + ": " + error.what());
      if (!dynamic_cast<const OutOfTime*>(&error)) continue;
      is_late = true;
      if (options.ends_when_stopped) break;
    }
  }
  std::string all = "no mesher fills the surface:";
  for (const std::string& failure : said.failures) all += "\n  " + failure;
  all += "\n./testbed run with --remesh first makes an even surface of it";
  if (is_late) throw OutOfTime(all);
  throw std::runtime_error(all);
}

}  // namespace testbed::meshing
