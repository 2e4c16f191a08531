#include "massspring/calibrations/calibrations.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {

/// One stiffness for every spring of the network, scaled to Young's modulus by affine theory: E = sum k r^2 /
/// (6 V) [the paper; (15), (16)]. Poisson's ratio is 1/4 whatever the material says.
void calibrate_uniform(MassSpringModel& model, const Eigen::Matrix2Xi& links) {
  const auto& [X, T, F, n_surface] = model.network;
  const Eigen::VectorXd r2 = squared_lengths(X, links);
  const double k = 6 * volume(X, F) * model.material.E / r2.sum();
  set_springs(model, links, Eigen::VectorXd::Constant(r2.size(), k));
}

/// The same scale, but every spring stands for the same volume: k ~ 1/r^2 [(16)].
void calibrate_affine(MassSpringModel& model, const Eigen::Matrix2Xi& links) {
  const auto& [X, T, F, n_surface] = model.network;
  const Eigen::VectorXd r2 = squared_lengths(X, links);
  const double kr2 = 6 * volume(X, F) * model.material.E / static_cast<double>(r2.size());
  set_springs(model, links, kr2 * r2.cwiseInverse());
}

}  // namespace testbed::massspring
