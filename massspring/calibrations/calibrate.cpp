#include "massspring/calibrations/calibrate.h"

#include <algorithm>
#include <array>
#include <set>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "massspring/calibrations/calibrations.h"
#include "meshing/algebra/subdomains.h"
#include "meshing/base/names.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {

SetStiffness calibrate_uniform, calibrate_affine, calibrate_van_gelder, calibrate_lloyd, calibrate_moment;

namespace {

/// Masses where there are no tetrahedra: internal nodes, spread evenly, weigh the same, surface nodes half as
/// much on average, in proportion to their area. The total is exact.
Eigen::VectorXd masses_without_tetrahedra(const SpringNetwork& network, double total) {
  Eigen::VectorXd mass = Eigen::VectorXd::Ones(network.X.cols());
  const Eigen::VectorXd areas = vertex_areas(network.X.leftCols(network.n_surface), network.F);
  mass.head(network.n_surface) = areas / areas.mean() / 2;
  return mass * (total / mass.sum());
}

/// Springs along the surface before those inside, both by subdomains, and in each by ascending nodes.
/// These follow a curve through space: whoever goes through the springs finds most nodes in the cache.
void sort_springs(MassSpringModel& model) {
  const TetMesh& network = model.network;
  const Eigen::Matrix2Xi E = model.springs->E, edges = edges_of(network.F);
  const auto n = static_cast<int>(E.cols());
  const bool is_subdivided = network.X.cols() >= kLeastSubdivided;
  const std::vector<int> leaf = is_subdivided ? leaves_of(network.X) : std::vector<int>(network.X.cols(), 0);
  std::set<std::pair<int, int>> surface;
  for (const auto& e : edges.colwise()) surface.insert(std::minmax(e(0), e(1)));
  std::vector<std::array<int, 4>> order(n);  // range, nodes, spring
  for (int s = 0; s < n; ++s) {
    const auto [a, b] = std::minmax(leaf[E(0, s)], leaf[E(1, s)]);
    const bool is_inside = surface.count(std::minmax(E(0, s), E(1, s))) == 0;
    order[s] = {subdomain_of(a, b) + (is_inside ? kSubdomains : 0), E(0, s), E(1, s), s};
  }
  std::sort(order.begin(), order.end());
  const Eigen::VectorXd stiffness = model.springs->stiffness;
  for (int s = 0; s < n; ++s) {
    model.springs->E.col(s) = E.col(order[s][3]);
    model.springs->stiffness(s) = stiffness(order[s][3]);
  }
  if (!is_subdivided) return;
  for (int range = 0; range <= 2 * kSubdomains; ++range)
    model.springs->first.push_back(static_cast<int>(
        std::lower_bound(order.begin(), order.end(), std::array<int, 4>{range, 0, 0, 0}) - order.begin()));
}

template <const Blend& blend>
void calibrate_coupled(MassSpringModel& model, const Eigen::Matrix2Xi&) {
  model.tet_springs =
      couple_springs(model.network.X, model.network.T, lame_of(model.material), blend, model.constrained);
}

}  // namespace

const std::vector<Calibration>& calibrations() {
  // Springs alone have nu = 1/4, which volume terms only raise; those without such terms take any nu for that.
  constexpr double kSprings = 0.25, kLeast = -1, kLargest = 0.5;
  static const std::vector<Calibration> kAll{
      {"uniform", true, false, false, kLeast, kLargest, calibrate_uniform},
      {"affine", true, false, false, kLeast, kLargest, calibrate_affine},
      {"van_gelder", false, true, false, kSprings, kLargestNu, calibrate_van_gelder},
      {"lloyd", false, true, false, kSprings, kLargestNu, calibrate_lloyd},
      {"moment", false, true, false, kSprings, kLargestNu, calibrate_moment},
      {"edge_coupled", false, true, true, kLeastNu, kLargestNu, calibrate_coupled<kEdgeCoupled>},
      {"node_averaged", false, true, true, kLeastNu, kLargestNu, calibrate_coupled<kNodeAveraged>}};
  return kAll;
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

void check_material(const Material& material, const Calibration& calibration) {
  constexpr double kRounding = 1e-12;
  if (material.nu >= calibration.least_nu - kRounding && material.nu <= calibration.largest_nu) return;
  std::ostringstream what;
  what << "material.nu = " << material.nu << ", expected " << calibration.least_nu << " to "
       << calibration.largest_nu << " with " << calibration.name << " springs";
  throw std::runtime_error(what.str());
}

MaterialShares divide_material(const Material& material, const Calibration& calibration, double share) {
  const std::string found = "network.link_share = " + std::to_string(share);
  if (!calibration.is_coupled)
    throw std::runtime_error(found + ", expected 0 with " + calibration.name +
                             " springs: they are not coupled");
  check_material(material, calibration);
  const auto [lambda, mu] = lame_of(material);
  if (share * mu > lambda * (1 + 1e-12))
    throw std::runtime_error(found + ", expected at most lambda/mu = " + std::to_string(lambda / mu) +
                             ": links alone have nu = 1/4");
  const double coupled_lambda = std::max(lambda - share * mu, 0.), coupled_mu = (1 - share) * mu;
  MaterialShares shares{material, material};
  shares.coupled.nu = coupled_lambda / (2 * (coupled_lambda + coupled_mu));
  shares.coupled.E = 2 * coupled_mu * (1 + shares.coupled.nu);
  shares.linked.nu = 0.25;
  shares.linked.E = 2.5 * share * mu;
  check_material(shares.coupled, calibration);
  return shares;
}

MassSpringModel calibrate(const SpringNetwork& network, const Material& material,
                          const Calibration& calibration, const std::vector<int>& constrained) {
  check_material(material, calibration);
  const auto refuse = [&](const char* missing) {
    throw std::runtime_error("network.calibration = '" + calibration.name + "': the network has no " +
                             missing + ", expected some");
  };
  if (calibration.needs_links && network.E.cols() == 0) refuse("links");
  if (calibration.needs_tetrahedra && network.T.cols() == 0) refuse("tetrahedra");
  MassSpringModel model;
  model.network = {network.X, network.T, network.F, network.n_surface};
  model.cuts = network.cuts;
  model.material = material;
  model.constrained = constrained;
  model.mass = network.T.cols() > 0
                   ? lumped_mass(network.X, network.T, material.rho)
                   : masses_without_tetrahedra(network, material.rho * volume(network.X, network.F));
  calibration.set_stiffness(model, network.E);
  if (model.springs) sort_springs(model);
  return model;
}

MassSpringModel calibrate_with_links(const SpringNetwork& network, const Material& material,
                                     const Calibration& calibration, double share,
                                     const std::vector<int>& constrained) {
  const auto [coupled, linked] = divide_material(material, calibration, share);
  MassSpringModel model = calibrate(network, coupled, calibration, constrained);
  const MassSpringModel links = calibrate(network, linked, find_calibration("uniform"));
  model.springs = links.springs;
  model.material = material;
  return model;
}

void set_springs(MassSpringModel& model, const Eigen::Matrix2Xi& E, const Eigen::VectorXd& stiffness) {
  model.springs = Springs{E, stiffness, 0};
}

Eigen::VectorXd squared_lengths(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E) {
  Eigen::VectorXd squared(E.cols());
  for (int s = 0; s < E.cols(); ++s) squared(s) = (X.col(E(0, s)) - X.col(E(1, s))).squaredNorm();
  return squared;
}

}  // namespace testbed::massspring
