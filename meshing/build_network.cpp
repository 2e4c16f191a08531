#include "meshing/build_network.h"

#include <algorithm>
#include <stdexcept>

#include "meshing/connect.h"
#include "meshing/interior_size.h"
#include "meshing/names.h"

namespace testbed {

namespace {

Eigen::Matrix3Xd sampled_nodes(const SurfaceMesh& surface, const NetworkOptions& options,
                               const std::string& sampling) {
  const SampleOptions sample{options.phi, options.psi, options.k, options.seed,
                             sampling == "relaxed" ? Sampling::Relaxed : Sampling::Darts};
  return sample_interior(surface, sample);
}

}  // namespace

SpringNetwork build_network(const SurfaceMesh& surface, const NetworkOptions& options, bool needs_tetrahedra,
                            TetReport* report) {
  const std::string sampling = !options.sampling.empty() ? options.sampling
                               : needs_tetrahedra        ? "mesher"
                                                         : "darts";
  const std::vector<std::string> known{"darts", "relaxed", "mesher"};
  if (std::find(known.begin(), known.end(), sampling) == known.end())
    throw std::runtime_error("network.sampling = '" + sampling + "'" + suggestion(sampling, known));

  TetOptions tets;
  if (sampling == "mesher") {
    tets.size = interior_size(surface, options.spacing);
  } else {
    tets.interior = sampled_nodes(surface, options, sampling);
    const double body = (surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff()).norm();
    tets.size = Eigen::VectorXd::Constant(surface.X.cols(), body);  // no more nodes than the mesher needs
  }
  TetMesh mesh;
  if (needs_tetrahedra || sampling == "mesher") {
    mesh = tetrahedralize(surface, tets, report);
    tets.interior = mesh.X.rightCols(mesh.X.cols() - mesh.n_surface);
  }
  ConnectOptions how;
  how.connectivity = connectivity_of(options.connectivity);
  how.pcp.multiplicity = options.multiplicity;
  how.neighbours = options.neighbours;
  SpringNetwork network = connect(surface, tets.interior, how);
  if (needs_tetrahedra) {
    if (network.X.cols() != mesh.X.cols())
      throw std::runtime_error("network.connectivity = '" + options.connectivity +
                               "' leaves out internal nodes that are corners of tetrahedra");
    network.T = mesh.T;
  }
  return network;
}

}  // namespace testbed
