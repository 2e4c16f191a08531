#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>

#include <cassert>

#include "meshing/surface/surface_check.h"

namespace testbed::meshing {

std::vector<std::pair<int, int>> self_intersections(const SurfaceMesh& surface) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
  Mesh mesh;
  for (const auto& x : surface.X.colwise()) mesh.add_vertex({x[0], x[1], x[2]});
  for (const auto& f : surface.F.colwise()) {
    [[maybe_unused]] const auto face =
        mesh.add_face(Mesh::Vertex_index(f[0]), Mesh::Vertex_index(f[1]), Mesh::Vertex_index(f[2]));
    assert(face != Mesh::null_face());
  }
  std::vector<std::pair<Mesh::Face_index, Mesh::Face_index>> found;
  CGAL::Polygon_mesh_processing::self_intersections(mesh, std::back_inserter(found));
  std::vector<std::pair<int, int>> pairs;
  for (const auto& [f, g] : found)
    pairs.push_back(std::minmax<int>({static_cast<int>(f), static_cast<int>(g)}));
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

}  // namespace testbed::meshing
