#include "meshing/network/delaunay.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <algorithm>

namespace testbed::meshing {

std::vector<std::pair<int, int>> delaunay_edges(const Eigen::Matrix3Xd& X) {
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Structure =
      CGAL::Triangulation_data_structure_3<CGAL::Triangulation_vertex_base_with_info_3<int, Kernel>>;
  using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;
  std::vector<std::pair<Kernel::Point_3, int>> points;
  for (int i = 0; i < X.cols(); ++i) points.push_back({{X(0, i), X(1, i), X(2, i)}, i});
  const Triangulation triangulation(points.begin(), points.end());
  std::vector<std::pair<int, int>> edges;
  for (auto e = triangulation.finite_edges_begin(); e != triangulation.finite_edges_end(); ++e)
    edges.push_back(
        std::minmax<int>({e->first->vertex(e->second)->info(), e->first->vertex(e->third)->info()}));
  std::sort(edges.begin(), edges.end());
  return edges;
}

}  // namespace testbed::meshing
