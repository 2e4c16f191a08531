#include "meshing/surface_energies/energy_ledger.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace testbed::meshing {
namespace {

/// A barrier that is touched has no finite energy: the first step leads to where it has.
bool is_finite(const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x) {
  return std::all_of(surface.begin(), surface.end(),
                     [&](const auto& energy) { return std::isfinite(energy->stored(x)); });
}

std::vector<double> stored_at(const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x) {
  std::vector<double> stored;
  for (const auto& energy : surface) {
    const double value = energy->stored(x);
    stored.push_back(std::isfinite(value) ? value : 0);
  }
  return stored;
}

}  // namespace

double EnergyLedger::surface_energy() const {
  return std::accumulate(stored_.begin(), stored_.end(), 0.);
}

/// What is there beyond what was put in since the beginning (J).
double EnergyLedger::balance(double kinetic, double elastic) const {
  return kinetic + elastic + surface_energy() - start_ - flows.put_in();
}

void EnergyLedger::begin(double kinetic, double elastic, const SurfaceEnergies& surface,
                         const Eigen::Matrix3Xd& x, double rounding) {
  *this = {};
  has_begun_ = true;
  is_open_ = !is_finite(surface, x);
  stored_ = stored_at(surface, x);
  surface_start_ = surface_energy();
  start_ = kinetic + elastic + surface_start_;
  rounding_ = rounding;
  largest_ = kinetic + elastic;
}

void EnergyLedger::change(double elastic, const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x,
                          double rounding) {
  const double before = surface_energy();
  stored_ = stored_at(surface, x);
  flows.events += elastic + surface_energy() - before;
  rounding_ = rounding;
}

void EnergyLedger::begin_step(const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x) {
  if (stored_.size() != surface.size()) {  // others act from here on
    const double before = surface_energy();
    stored_ = stored_at(surface, x);
    flows.targets += surface_energy() - before;
  }
  for (size_t i = 0; i < surface.size(); ++i)
    if (!surface[i]->is_stiff()) flows.targets += surface[i]->stored(x) - stored_[i];
}

void EnergyLedger::end_step(const SurfaceEnergies& surface, const Eigen::Matrix3Xd& x) {
  stored_ = stored_at(surface, x);
  for (const auto& energy : surface) {
    flows.friction += energy->friction(x);
    (energy->is_stiff() ? flows.obstacles : flows.targets) += energy->work(x);
  }
}

void EnergyLedger::settle(double kinetic, double elastic) {
  if (is_open_) {
    is_open_ = false;
    start_ += balance(kinetic, elastic);
    surface_start_ = surface_energy();
  }
  const double now = balance(kinetic, elastic);
  largest_ = std::max(
      {largest_, kinetic + elastic, std::abs(surface_energy() - surface_start_), std::abs(flows.loads)});
  least_ = std::min(least_, now);
  if (const double grown = now - least_; grown > rounding_) gain_ = std::max(gain_, grown / largest_);
}

std::vector<std::pair<std::string, double>> EnergyLedger::columns(const SurfaceEnergies& surface,
                                                                  double kinetic, double elastic) const {
  std::vector<std::pair<std::string, double>> columns;
  for (size_t i = 0; i < std::min(surface.size(), stored_.size()); ++i) {
    const std::string name = std::string(surface[i]->name()) + "_energy";
    const auto same = std::find_if(columns.begin(), columns.end(),
                                   [&](const auto& column) { return column.first == name; });
    if (same == columns.end())
      columns.emplace_back(name, stored_[i]);
    else
      same->second += stored_[i];
  }
  columns.insert(columns.end(),
                 {{"work_of_loads", flows.loads},
                  {"work_of_supports", flows.supports},
                  {"work_of_obstacles", flows.obstacles},
                  {"work_of_targets", flows.targets},
                  {"work_of_rest", flows.rest},
                  {"work_of_events", flows.events},
                  {"lost_to_damping", flows.damping},
                  {"lost_to_friction", flows.friction},
                  {"lost_to_scheme", -balance(kinetic, elastic) - flows.damping - flows.friction}});
  return columns;
}

}  // namespace testbed::meshing
