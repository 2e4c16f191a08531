// How far coupled springs are off by their own account, and where they want more nodes.
#pragma once

#include <vector>

#include "massspring/simulation.h"

namespace testbed::massspring {

/// Whether what came before decides an equilibrium.
bool has_friction(const Scene& scene);

/// Of the surface's displacement at full load.
struct ErrorEstimate {
  double error;               ///< relative, in the L2 norm
  Eigen::VectorXd of_vertex;  ///< m, at the surface's vertices
};

/// Of an equilibrium of coupled springs under full load, by its distance to that of the same tetrahedra split in eight, as
/// if errors fell with the square of their edges. The latter starts from the former and is solved to what an estimate
/// needs. With friction it starts undeformed and takes the scene's load steps.
/// @param u       displacements (m), 3 x n
/// @param coarse  simulation that found them, whose solver serves the finer network's; null, or with friction: that has its own
/// @throws std::runtime_error when the finer network finds no equilibrium or is too large, and where nothing deforms.
ErrorEstimate estimate_error(const Scene& scene, const SpringNetwork& network, const Eigen::Matrix3Xd& u,
                             const Simulation* coarse = nullptr);

/// Edges over thickness beyond which springs bend so little, and those of halved edges, too, that their distance tells nothing.
constexpr double kTooThin = 20;
/// The median over the surface of the longest edge over the thickness beneath it.
double edges_over_thickness(const SpringNetwork& network);

struct AdaptedSurface {
  SurfaceMesh surface;
  SpringNetwork network;
  ErrorEstimate estimate;
  std::vector<int> n_nodes;    ///< of the networks on the way
  std::vector<double> errors;  ///< of each, as they were estimated
  bool is_reached;
};

/// Cuts the triangles near which strain jumps most, until the estimated error falls below a target.
/// @throws std::runtime_error when a network finds no equilibrium.
AdaptedSurface adapt_surface(const Scene& scene, const SurfaceMesh& surface, double target);

}  // namespace testbed::massspring
