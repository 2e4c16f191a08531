// Equilibria on finer triangles: how far coupled springs are off, and where they want more nodes.
#pragma once

#include <vector>

#include "massspring/simulation.h"

namespace testbed::massspring {

/// Of the surface's displacement at full load.
struct ErrorEstimate {
  double error;               ///< relative, in the L2 norm
  Eigen::VectorXd of_vertex;  ///< m, at the surface's vertices that the coarser network has, which come first
};

/// Of springs on a surface, by their distance to those on the same triangles cut in four, as if errors fell with
/// the square of its edges.
/// @throws std::runtime_error when one of them finds no equilibrium.
ErrorEstimate estimate_error(const Scene& scene, const SurfaceMesh& surface, const SpringNetwork& network);

struct AdaptedSurface {
  SurfaceMesh surface;
  SpringNetwork network;
  ErrorEstimate estimate;
  std::vector<int> n_nodes;    ///< of the networks on the way
  std::vector<double> errors;  ///< of all but the first, as they were estimated
  bool is_reached;
};

/// Cuts the triangles near which strain jumps most, until the error falls below a target that is estimated, likewise,
/// by the distance of the last two networks.
/// @throws std::runtime_error when a network finds no equilibrium.
AdaptedSurface adapt_surface(const Scene& scene, const SurfaceMesh& surface, double target);

}  // namespace testbed::massspring
