// Measures and checks of triangle surfaces.
#pragma once

#include <string>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Enclosed volume (m3) by the divergence theorem about the
/// centroid; positive when oriented outward [paper 3.3].
double volume(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

/// Area of the surface (m2).
double area(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

/// Area times outward unit normal of each triangle, 3 x m (m2).
Eigen::Matrix3Xd area_vectors(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

/// A third of the area of its triangles, for each vertex (m2).
Eigen::VectorXd vertex_areas(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

/// True when the triangles leave no open edge: every edge is met once in each direction.
bool is_closed(const Eigen::Matrix3Xi& F);

/// Undirected edges, 2 x n_edges, i < j, in ascending order.
Eigen::Matrix2Xi edges_of(const Eigen::Matrix3Xi& F);

/// @throws std::runtime_error naming `name`, what is wrong and where, unless the surface is closed, manifold,
/// consistently and outwardly oriented and free of degenerate triangles.
void check_closed(const SurfaceMesh& surface, const std::string& name);

}  // namespace testbed::meshing
