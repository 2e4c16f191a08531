#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

namespace testbed::meshing {

/// Edges (i < j) of the Delaunay tetrahedra of points (3 x n), in ascending order; exact predicates (CGAL).
std::vector<std::pair<int, int>> delaunay_edges(const Eigen::Matrix3Xd& X);

}  // namespace testbed::meshing
