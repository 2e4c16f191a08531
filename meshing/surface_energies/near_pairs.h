// Pairs of a surface's parts that are near each other: vertices with triangles and edges with edges.
#pragma once

#include <Eigen/Core>
#include <array>
#include <functional>

namespace testbed::meshing {

/// Vertex 0 and triangle 1-2-3, or edge 0-1 and edge 2-3.
using PairNodes = std::array<int, 4>;
using PairWeights = std::array<double, 4>;

/// Points of the two parts that are nearest to each other: e = sum w_a x_a leads from the second to the first.
struct NearestPoints {
  PairWeights weight;
  Eigen::Matrix<double, 4, 2> slides;  ///< weights by the coordinates in which these points can slide
  int n_slides;  ///< none at vertices, one along an edge, two on faces and where edges cross
};

NearestPoints nearest_points(const PairNodes& node, bool is_edges, const Eigen::Matrix3Xd& x);

/// sum w_a x_a.
Eigen::Vector3d between(const PairNodes& node, const PairWeights& w, const Eigen::Matrix3Xd& x);

/// How much less than whole the energy of a pair of edges is that are nearly parallel, so that it has a gradient
/// [Li et al. 2020]: m = (2 - q) q of the squared cross product over `least`, q < 1.
struct Smoothing {
  double m = 1;
  Eigen::Matrix<double, 12, 1> gradient = Eigen::Matrix<double, 12, 1>::Zero();   ///< by the four nodes (1/m)
  Eigen::Matrix<double, 12, 12> hessian = Eigen::Matrix<double, 12, 12>::Zero();  ///< 1/m2
};
/// @param least  of least_cross
Smoothing smoothing_of_edges(const PairNodes& node, const Eigen::Matrix3Xd& x, double least);
/// The squared cross product (m4) below which edges are smoothed: that of a sine of a tenth at rest X.
double least_cross(const PairNodes& node, const Eigen::Matrix3Xd& X);

/// Calls visit(nodes, is_edges) for every pair without a node in common whose boxes are closer than `gap` (m), in
/// no order.
/// @param vertices  of the surface
void for_each_candidate(const Eigen::VectorXi& vertices, const Eigen::Matrix2Xi& edges,
                        const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, double gap,
                        const std::function<void(const PairNodes& node, bool is_edges)>& visit);

}  // namespace testbed::meshing
