// Surfaces whose triangles are too large for what they enclose, cut into smaller ones of the same planes.
#pragma once

#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// A surface, and whether thinner parts than it could be cut for are left.
struct CutSurface {
  SurfaceMesh surface;
  bool is_bounded;
};

/// Cuts triangles until `across` edges fit through the body, by some four times its vertices or 5,000 at most: a
/// thin sheet would take them without end. 0 cuts none. Triangles of one plane are Delaunay's, from before the first cut
/// to the last [Rivara 1997]. Where none is to be cut this mends caps alone, whose third corner lies on their longest edge,
/// as CAD programs write them.
/// @param coarser  times the edges that triangles would else be cut to
/// @param parts    of the vertices, by which edges and triangles are held or loaded: they hold the same of the surface
///                 afterwards
CutSurface cut_across(const SurfaceMesh& surface, double across, double coarser = 1,
                      const std::vector<std::vector<bool>>& parts = {});

/// Of each triangle (m).
Eigen::VectorXd longest_edges(const SurfaceMesh& surface);

/// Longest edge wanted of each triangle (m): that of which `across` fit through the body from its centroid
/// inward, and no more than fit a body of this volume, however thick it is there.
/// @param across  > 0
Eigen::VectorXd edges_across(const SurfaceMesh& surface, double across);

/// Bisects edges that are longer than wanted, those most so first. A triangle is always cut at its longest
/// edge, so that no angle becomes less than half of the least one before [Rivara 1984]. A surface that is cut
/// already may be cut further.
/// @param longest  of each triangle's edges (m)
/// @param most     vertices that the result has no more than, but for those that end a cut
SurfaceMesh cut_surface(const SurfaceMesh& surface, const Eigen::VectorXd& longest, int most);

/// Vertices before that the middle of an edge lies between: of its ends, where these are parts of one edge before.
/// @param a, b     those that its ends lie between
/// @param corners  of the triangle that one beside it is a part of
Eigen::Vector3i between_halves(const Eigen::Vector3i& a, const Eigen::Vector3i& b,
                               const Eigen::Vector3i& corners);

}  // namespace testbed::meshing
