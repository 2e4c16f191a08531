// The spring network that a scene asks for.
#pragma once

#include "meshing/base/mesh.h"
#include "meshing/network/network.h"
#include "meshing/scene/scene.h"
#include "meshing/tetrahedra/tetrahedralize.h"

namespace testbed::meshing {

/// How nodes were found.
struct NodeReport {
  SampleReport samples;  ///< where nodes were sampled
  TetReport tets;        ///< where a mesher was asked
  /// No mesher filled the surface around sampled nodes, so that these are the mesher's.
  bool is_mesher_instead = false;
};

/// Internal nodes sampled or made by the mesher, as the scene's network table says, with tetrahedra where
/// wanted (or where the mesher made the nodes). Sampled nodes stay as they are; those that the mesher must
/// add to them follow. Where no mesher can keep them, its own take their place, unless k or phi is given.
/// @throws std::runtime_error for a sampling that is not known or options out of range, or when no mesher
/// fills the surface.
/// @param tets  how long and where meshers run; the rest is filled in
TetMesh place_nodes(const SurfaceMesh& surface, const NetworkOptions& options, bool needs_tetrahedra,
                    NodeReport* report = nullptr, TetOptions tets = {});

/// These nodes, joined by springs as the table says and with their tetrahedra, each where wanted.
/// @throws std::runtime_error as place_nodes, or for a connectivity that is not known or leaves out corners
/// of tetrahedra.
SpringNetwork build_network(const SurfaceMesh& surface, const NetworkOptions& options, bool needs_links,
                            bool needs_tetrahedra, NodeReport* report = nullptr);

}  // namespace testbed::meshing
