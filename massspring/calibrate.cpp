#include "massspring/calibrate.h"

#include <algorithm>
#include <stdexcept>

#include "meshing/surface.h"

namespace testbed {
namespace {

/// Masses where there are no tetrahedra: the cube of the mean length of a node's springs, halved on the
/// surface, scaled so that the total is exact.
Eigen::VectorXd masses_from_springs(const SpringNetwork& network, double total) {
  const int n = static_cast<int>(network.X.cols());
  Eigen::VectorXd length = Eigen::VectorXd::Zero(n), degree = Eigen::VectorXd::Zero(n);
  for (const auto& s : network.E.colwise())
    for (int i : s) {
      length(i) += (network.X.col(s(0)) - network.X.col(s(1))).norm();
      degree(i) += 1;
    }
  Eigen::VectorXd mass = (length.array() / degree.array().max(1)).cube();
  mass.head(network.n_surface) /= 2;
  return mass * (total / mass.sum());
}

Eigen::VectorXd squared_lengths(const SpringNetwork& network) {
  Eigen::VectorXd squared(network.E.cols());
  for (int s = 0; s < network.E.cols(); ++s)
    squared(s) = (network.X.col(network.E(0, s)) - network.X.col(network.E(1, s))).squaredNorm();
  return squared;
}

}  // namespace

const std::vector<Calibration>& calibrations() {
  static const std::vector<Calibration> all{{"uniform", false},
                                            {"affine", false},
                                            {"edge_coupled", true},
                                            {"node_averaged", true},
                                            {"edge_averaged", true}};
  return all;
}

const Calibration& find_calibration(const std::string& name) {
  std::string known;
  for (const Calibration& c : calibrations()) {
    if (c.name == name) return c;
    known += (known.empty() ? "" : ", ") + c.name;
  }
  throw std::runtime_error("network.calibration = '" + name + "', expected one of " + known);
}

MassSpringModel calibrate(const SpringNetwork& network, const Material& material,
                          const Calibration& calibration) {
  MassSpringModel model;
  model.network = network;
  model.material = material;
  if (calibration.needs_tetrahedra) {
    model.mass = lumped_mass(network.X, network.T, material.rho);
    model.tet_springs = couple_springs(network.X, network.T, lame_of(material),
                                       calibration.name == "edge_coupled"    ? edge_coupled
                                       : calibration.name == "node_averaged" ? node_averaged
                                                                             : edge_averaged);
    return model;
  }
  // An affinely deformed isotropic network has E = sum k r^2 / (6 V) and nu = 1/4 [method 6].
  const double V = volume(network.X, network.F);
  const Eigen::VectorXd r2 = squared_lengths(network);
  const int n_springs = static_cast<int>(r2.size());
  model.mass = masses_from_springs(network, material.rho * V);
  Springs springs;
  springs.E = network.E;
  if (calibration.name == "uniform")
    springs.stiffness = Eigen::VectorXd::Constant(n_springs, 6 * V * material.E / r2.sum());
  else  // affine: every spring stands for the same volume
    springs.stiffness = 6 * V * material.E / n_springs * r2.cwiseInverse();
  model.springs = springs;
  return model;
}

}  // namespace testbed
