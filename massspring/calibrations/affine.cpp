#include "massspring/calibrations/calibrations.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {

void calibrate_uniform(MassSpringModel& model) {
  const SpringNetwork& network = model.network;
  const Eigen::VectorXd r2 = squared_lengths(network.X, network.E);
  const double k = 6 * volume(network.X, network.F) * model.material.E / r2.sum();
  set_springs(model, network.E, Eigen::VectorXd::Constant(r2.size(), k));
}

void calibrate_affine(MassSpringModel& model) {
  const SpringNetwork& network = model.network;
  const Eigen::VectorXd r2 = squared_lengths(network.X, network.E);
  const double kr2 = 6 * volume(network.X, network.F) * model.material.E / static_cast<double>(r2.size());
  set_springs(model, network.E, kr2 * r2.cwiseInverse());
}

}  // namespace testbed::massspring
