// Whether a simulation can use a surface, as a report.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Pairs of triangles that intersect, other than along what they share, by exact predicates (CGAL). The
/// surface must be manifold and consistently oriented.
std::vector<std::pair<int, int>> self_intersections(const SurfaceMesh& surface);

/// Longest edge over shortest height: a needle has more than this, and many meshers and solvers fail on it.
constexpr double kNeedleAspect = 100;

struct Needles {
  int n = 0;         ///< triangles
  double worst = 0;  ///< aspect of any triangle; infinite without area
};
Needles needles_of(const SurfaceMesh& surface);

struct SurfaceReport {
  nlohmann::ordered_json values;      ///< vertices, faces, ... in the order to print
  std::vector<std::string> problems;  ///< why a simulation cannot use it; empty if it can
};

/// Counts, measures and faults of a surface as read. `n_merged` is the reader's count of equal positions.
SurfaceReport report_surface(const SurfaceMesh& surface, int n_merged);

}  // namespace testbed::meshing
