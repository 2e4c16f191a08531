// From a surface to a spring network: internal nodes, then springs by projective cascading propagation.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "meshing/mesh.h"

namespace testbed {

struct SampleOptions {
  std::optional<double> phi;  ///< least distance between internal nodes, in the normalised box; from the
                              ///< surface's edges if absent
  std::optional<double>
      psi;  ///< least distance to the surface, in the normalised box; from the surface's edges if absent
  std::optional<int> k;  ///< nodes wanted; as many as fit if absent
  std::uint64_t seed = 1;
};

/// Random internal nodes, 3 x k' with k' <= k (m) [paper 4.2, fig. 4]. Always ends; the same seed gives the
/// same nodes everywhere.
Eigen::Matrix3Xd sample_interior(const SurfaceMesh& surface, const SampleOptions& options);

struct PcpOptions {
  int multiplicity = 5;  ///< springs projected by each white node, >= 3
};

struct PcpReport {
  std::vector<int> white_per_stage;  ///< white nodes dequeued in each stage
};

/// Links surface and internal nodes by projective cascading propagation [paper 4.2, fig. 8], stage by stage.
SpringNetwork link_pcp(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                       const PcpOptions& options, PcpReport* report = nullptr);

}  // namespace testbed
