#include "massspring/calibrate.h"

#include <algorithm>
#include <stdexcept>

#include "massspring/calibrations/calibrations.h"
#include "meshing/names.h"
#include "meshing/surface.h"

namespace testbed {
namespace {

/// Masses where there are no tetrahedra: internal nodes, spread evenly, weigh the same, surface nodes half as
/// much on average, in proportion to their area. The total is exact.
Eigen::VectorXd masses_without_tetrahedra(const SpringNetwork& network, double total) {
  Eigen::VectorXd mass = Eigen::VectorXd::Ones(network.X.cols());
  const Eigen::VectorXd areas = vertex_areas(network.X.leftCols(network.n_surface), network.F);
  mass.head(network.n_surface) = areas / areas.mean() / 2;
  return mass * (total / mass.sum());
}

/// Springs inside the body by ascending nodes, which follow a curve through space: whoever goes through the
/// springs finds most of their nodes in the cache.
void sort_springs(SpringNetwork& network) {
  const auto less = [](const auto& s, const auto& t) { return s(0) != t(0) ? s(0) < t(0) : s(1) < t(1); };
  std::vector<Eigen::Vector2i> inside;
  const Eigen::Index n_edges = std::min(network.F.cols() * 3 / 2, network.E.cols());
  for (const auto& s : network.E.rightCols(network.E.cols() - n_edges).colwise()) inside.push_back(s);
  std::sort(inside.begin(), inside.end(), less);
  for (size_t s = 0; s < inside.size(); ++s)
    network.E.col(n_edges + static_cast<Eigen::Index>(s)) = inside[s];
}

template <const Blend& blend>
void calibrate_coupled(MassSpringModel& model) {
  model.tet_springs = couple_springs(model.network.X, model.network.T, lame_of(model.material), blend);
}

}  // namespace

const std::vector<Calibration>& calibrations() {
  static const std::vector<Calibration> all{{"uniform", false, calibrate_uniform},
                                            {"affine", false, calibrate_affine},
                                            {"van_gelder", true, calibrate_van_gelder},
                                            {"lloyd", true, calibrate_lloyd},
                                            {"moment", true, calibrate_moment},
                                            {"edge_coupled", true, calibrate_coupled<edge_coupled>},
                                            {"node_averaged", true, calibrate_coupled<node_averaged>}};
  return all;
}

const Calibration& find_calibration(const std::string& name) {
  std::vector<std::string> known;
  for (const Calibration& c : calibrations()) {
    if (c.name == name) return c;
    known.push_back(c.name);
  }
  throw std::runtime_error("network.calibration = '" + name + "': no such spring model" +
                           suggestion(name, known));
}

MassSpringModel calibrate(const SpringNetwork& network, const Material& material,
                          const Calibration& calibration) {
  if (calibration.needs_tetrahedra && network.T.cols() == 0)
    throw std::runtime_error("network.calibration = '" + calibration.name +
                             "': the network has no tetrahedra, expected some");
  MassSpringModel model;
  model.network = network;
  sort_springs(model.network);
  model.material = material;
  model.mass = network.T.cols() > 0
                   ? lumped_mass(network.X, network.T, material.rho)
                   : masses_without_tetrahedra(network, material.rho * volume(network.X, network.F));
  calibration.set_stiffness(model);
  return model;
}

MassSpringModel calibrate_with_links(const SpringNetwork& network, const Material& material,
                                     const Calibration& calibration, double share) {
  const auto [lambda, mu] = lame_of(material);
  const std::string found = "network.link_share = " + std::to_string(share);
  if (share * mu > lambda * (1 + 1e-12))
    throw std::runtime_error(found + ", expected at most lambda/mu = " + std::to_string(lambda / mu) +
                             ": links alone have nu = 1/4");
  const double coupled_lambda = std::max(lambda - share * mu, 0.), coupled_mu = (1 - share) * mu;
  Material coupled = material, linked = material;
  coupled.nu = coupled_lambda / (2 * (coupled_lambda + coupled_mu));
  coupled.E = 2 * coupled_mu * (1 + coupled.nu);
  linked.nu = 0.25;
  linked.E = 2.5 * share * mu;
  MassSpringModel model = calibrate(network, coupled, calibration);
  if (!model.tet_springs || model.springs)
    throw std::runtime_error(found + ", expected 0 with " + calibration.name +
                             " springs: they are not coupled");
  model.springs = calibrate(network, linked, find_calibration("uniform")).springs;
  model.material = material;
  return model;
}

void set_springs(MassSpringModel& model, const Eigen::Matrix2Xi& E, const Eigen::VectorXd& stiffness) {
  model.network.E = E;
  model.springs = Springs{E, stiffness, 0};
}

Eigen::VectorXd squared_lengths(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E) {
  Eigen::VectorXd squared(E.cols());
  for (int s = 0; s < E.cols(); ++s) squared(s) = (X.col(E(0, s)) - X.col(E(1, s))).squaredNorm();
  return squared;
}

}  // namespace testbed
