#include "meshing/build_network.h"

#include <stdexcept>

#include "meshing/connect.h"
#include "meshing/names.h"

namespace testbed {

SpringNetwork build_network(const SurfaceMesh& surface, const NetworkOptions& options) {
  SampleOptions sample{options.phi, options.psi, options.k, options.seed, Sampling::Darts};
  if (options.sampling == "relaxed")
    sample.sampling = Sampling::Relaxed;
  else if (options.sampling != "darts")
    throw std::runtime_error("network.sampling = '" + options.sampling + "'" +
                             suggestion(options.sampling, {"darts", "relaxed"}));
  ConnectOptions how;
  how.connectivity = connectivity_of(options.connectivity);
  how.pcp.multiplicity = options.multiplicity;
  how.neighbours = options.neighbours;
  return connect(surface, sample_interior(surface, sample), how);
}

}  // namespace testbed
