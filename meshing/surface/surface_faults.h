// What can be wrong with a triangle surface, each fault by its places.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Every list is empty for a surface that a simulation can use.
struct SurfaceFaults {
  std::vector<int> unused_vertices;
  std::vector<int> degenerate_triangles;           ///< no area, to rounding
  std::vector<int> doubled_triangles;              ///< an earlier triangle has the same vertices
  std::vector<std::pair<int, int>> open_edges;     ///< one triangle
  std::vector<std::pair<int, int>> crowded_edges;  ///< three and more
  /// Two triangles run along it in the same direction.
  std::vector<std::pair<int, int>> disoriented_edges;
  std::vector<int> split_vertices;  ///< more than one fan of triangles
  /// The first one of each shell that is not outward, or inward for a cavity.
  std::vector<int> misturned_triangles;

  bool is_closed() const { return open_edges.empty(); }
  bool is_manifold() const { return crowded_edges.empty() && split_vertices.empty(); }
  bool none() const;
};

/// Indices must be in range. Fans are looked for only where all edges
/// have two triangles, shells only where also orientations agree.
SurfaceFaults find_faults(const SurfaceMesh& surface);

/// One line per kind of fault: how many, and where the first lies ("edge 3 (0, 1, 0) to 7 (...)").
std::vector<std::string> describe(const SurfaceFaults& faults, const SurfaceMesh& surface);

/// "12 (0.5, 0, 1)"
std::string vertex_text(const SurfaceMesh& surface, int vertex);

struct RepairReport {
  int n_unused_vertices = 0;       ///< dropped
  int n_degenerate_triangles = 0;  ///< with a vertex twice, dropped
  int n_doubled_triangles = 0;  ///< with the vertices of another, dropped (both, when they face each other)
  int n_turned_triangles = 0;   ///< given the other orientation
};

/// Drops what bounds nothing and orients every shell outward, or inward for a cavity. Never moves or adds
/// anything: what it cannot mend is left for find_faults.
SurfaceMesh repair(const SurfaceMesh& surface, RepairReport& report);

}  // namespace testbed::meshing
