// From a surface to a spring network: internal nodes, then springs by projective cascading propagation.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "meshing/base/choices.h"
#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// Lengths are in the normalised box, whose smallest side is 1 [paper 4.2].
struct SampleOptions {
  std::optional<double> phi;  ///< least distance between internal nodes; from the surface if absent
  std::optional<double> psi;  ///< least distance to the surface; from the surface if absent
  std::optional<int> k;       ///< nodes wanted; as many as fit if absent, see sample_interior
  std::uint64_t seed = 1;
  Sampling sampling = Sampling::Darts;
};

/// What was sampled.
struct SampleReport {
  double phi = 0, psi = 0;        ///< as taken (normalised box)
  std::optional<int> most_nodes;  ///< that bounded their number, where it did
};

/// Random internal nodes, 3 x k' with k' <= k (m) [paper 4.2, fig. 4].
/// Always ends; the same seed gives the same nodes everywhere.
/// Where neither k nor phi is given, phi grows until no more than three nodes fit for each of the surface: a
/// body that is thin beside its edges would take many times as many, which gain it nothing.
/// @throws std::runtime_error for options out of range or a grid too fine to store.
Eigen::Matrix3Xd sample_interior(const SurfaceMesh& surface, const SampleOptions& options,
                                 SampleReport* report = nullptr);

/// The options with phi and psi filled in: the mean surface
/// edge (less in a body thinner than that) and half of that.
SampleOptions fill_spacing(const SurfaceMesh& surface, SampleOptions options);

/// Moves internal nodes (3 x k) by Lloyd steps towards a centroidal Voronoi distribution in the body, the
/// surface's vertices being sites that stay; no node rises above least_depth (m) [Lloyd 1982].
/// @param is_graded  as dense as the surface nearby, else evenly
Eigen::Matrix3Xd relax_interior(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                                double least_depth, std::uint64_t seed, bool is_graded);

/// White nodes project to those of least distance + degree_weight * springs there + depth_weight * depth
/// below the surface.
struct PcpOptions {
  int multiplicity = 5;  ///< springs projected by each white node, >= 3
  PcpReading reading = PcpReading::StageWise;
  double degree_weight = 0;  ///< m for a spring, >= 0
  double depth_weight = 0;   ///< 1, >= 0
};

struct PcpReport {
  std::vector<int> white_per_stage;  ///< white nodes dequeued in each stage
};

/// Links surface and internal nodes by projective cascading propagation [paper 4.2, fig. 8]:
/// every white node projects springs to the nearest nodes that are not white, or by the options' weights.
/// At equal distance, the node of least degree is taken, then that of least index.
/// @throws std::runtime_error for a multiplicity below 3 or a negative weight.
SpringNetwork link_pcp(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                       const PcpOptions& options, PcpReport* report = nullptr);

}  // namespace testbed::meshing
