#include "meshing/network/build_network.h"

#include <stdexcept>

#include "meshing/base/names.h"
#include "meshing/network/connect.h"
#include "meshing/scene/scene_keys.h"
#include "meshing/tetrahedra/interior_size.h"

namespace testbed::meshing {

TetMesh place_nodes(const SurfaceMesh& surface, const NetworkOptions& options, bool needs_tetrahedra,
                    NodeReport* report, TetOptions tets) {
  NodeReport own;
  NodeReport& said = report ? *report : own;
  said = NodeReport();
  if (options.sampling == "mesher") {
    tets.size = interior_size(surface, options.spacing);
    return tetrahedralize(surface, tets, &said.tets);
  }
  const std::optional<Sampling> sampling = value_of<Sampling>(options.sampling);
  if (!sampling)
    throw std::runtime_error("network.sampling = '" + options.sampling + "'" +
                             suggestion(options.sampling, kSamplings));
  tets.interior =
      sample_interior(surface, {options.phi, options.psi, options.k, options.seed, *sampling}, &said.samples);
  if (needs_tetrahedra) {
    tets.size = largest_size(surface);
    tets.ends_when_stopped =
        !options.k && !options.phi;  // nodes inside are what takes the time: on with fewer
    try {
      return tetrahedralize(surface, tets, &said.tets);
    } catch (const std::runtime_error& error) {
      if (options.k || options.phi)
        throw std::runtime_error(std::string(error.what()) +
                                 "\nThe inner nodes were sampled as network.k or network.phi asks; "
                                 "network.sampling = 'mesher' lets the mesher choose them.");
    }
    said.is_mesher_instead = true;
    const std::vector<std::string> failures = said.tets.failures;
    tets.interior.resize(3, 0);
    tets.size = interior_size(surface, options.spacing);
    tets.ends_when_stopped = false;
    tets.is_tetgen_first = surface.cuts.F.size() > 0;  // the other one has failed, and takes longer
    TetMesh mesh = tetrahedralize(surface, tets, &said.tets);
    said.tets.failures.insert(said.tets.failures.begin(), failures.begin(), failures.end());
    return mesh;
  }
  const Eigen::Index n_surface = surface.X.cols();
  TetMesh nodes{
      Eigen::Matrix3Xd(3, n_surface + tets.interior.cols()), {}, surface.F, static_cast<int>(n_surface)};
  nodes.X << surface.X, tets.interior;
  return nodes;
}

SpringNetwork build_network(const SurfaceMesh& surface, const NetworkOptions& options, bool needs_links,
                            bool needs_tetrahedra, NodeReport* report) {
  TetMesh nodes = place_nodes(surface, options, needs_tetrahedra, report);
  if (!needs_links) return {nodes.X, nodes.F, {}, nodes.T, nodes.n_surface, surface.cuts};
  ConnectOptions how;
  how.connectivity = connectivity_of(options.connectivity);
  how.pcp.multiplicity = options.multiplicity;
  how.pcp.reading = options.reading;
  how.pcp.degree_weight =
      options.degree_weight * (surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff()).minCoeff();
  how.pcp.depth_weight = options.depth_weight;
  how.neighbours = options.neighbours;
  SpringNetwork network = connect(surface, nodes.X.rightCols(nodes.X.cols() - nodes.n_surface), how);
  network.cuts = surface.cuts;
  if (needs_tetrahedra) {
    if (network.X.cols() != nodes.X.cols())
      throw std::runtime_error("network.connectivity = '" + options.connectivity +
                               "' leaves out internal nodes that are corners of tetrahedra");
    network.T = std::move(nodes.T);
  }
  return network;
}

}  // namespace testbed::meshing
