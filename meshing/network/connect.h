// Ways to join surface and internal nodes by springs,
// PCP among them, and whether the result can hold its shape.
#pragma once

#include <string>
#include <vector>

#include "meshing/base/choices.h"
#include "meshing/base/mesh.h"
#include "meshing/network/network.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {

/// @throws std::runtime_error for a name not among them.
Connectivity connectivity_of(const std::string& name);

struct ConnectOptions {
  Connectivity connectivity = Connectivity::Pcp;
  PcpOptions pcp;
  int neighbours = 8;  ///< completed PCP: nearest neighbours of every node, >= 1
};

/// Springs, the surface's edges first. Delaunay and completed PCP have none that leaves the solid.
/// @throws std::runtime_error for options out of range, or more pairs than memory holds.
SpringNetwork connect(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                      const ConnectOptions& options, PcpReport* report = nullptr);

/// Whether the segment between two nodes stays inside the
/// surface of `tree`; nodes below n_surface are its vertices.
bool is_inside(const SurfaceTree& tree, const Eigen::Matrix3Xd& X, int n_surface, int i, int j);

/// Adds links to `springs` (pairs i < j) until the rank of the springs' directions is 3 n - 6 for each
/// connected part. The proof is constructive and begins with a triangle. A node belongs to a rigid part
/// when springs in three independent directions tie it there. So the rigidity matrix is block triangular
/// with regular 3 x 3 blocks. Linear in n. Returns the nodes that no link inside the solid could tie.
std::vector<int> make_rigid(const SurfaceMesh& surface, const SurfaceTree& tree, const Eigen::Matrix3Xd& X,
                            std::vector<std::pair<int, int>>& springs);

}  // namespace testbed::meshing
