#include "meshing/scene/changed_keys.h"

#include <map>
#include <stdexcept>

namespace testbed::meshing {
namespace {

/// Whether a run may go on under another value of a key.
bool is_changeable(const std::string& key) {
  for (const char* whole : {"material.E", "material.nu", "gravity", "loads.pressure", "time.integrator",
                            "time.step", "reference.integrator", "reference.spectral_radius"})
    if (key == whole) return true;
  return is_of(key, "collapse") || is_of(key, "obstacles") || is_of(key, "handles");
}

}  // namespace

bool is_of(const std::string& key, const std::string& table) {
  return key.rfind(table + ".", 0) == 0;
}

std::set<std::string> changed_keys(const Scene& before, const Scene& after) {
  if (law_of(before) != law_of(after))
    throw std::runtime_error("material.law = " + std::string(name_of(law_of(after))) +
                             " in a run that began with another one");
  std::map<std::string, std::vector<std::string>> values[2];
  for (const int k : {0, 1})
    for (const SceneKey& key : keys_of(k == 0 ? before : after))
      if (!is_of(key.path, "events")) values[k][key.path].push_back(key.value);
  std::set<std::string> changed;
  for (const int k : {0, 1})
    for (const auto& [key, value] : values[k]) {
      const auto other = values[1 - k].find(key);
      if (other == values[1 - k].end() || other->second != value) changed.insert(key);
    }
  for (const std::string& key : changed)
    if (!is_changeable(key)) throw std::runtime_error(key + " changes in a run, expected a new run");
  return changed;
}

int n_steps_from(const TimeOptions& time, double step, double t, int n_done) {
  constexpr double kRounding = 1e-6;  // of a step, of the sum of those so far
  TimeOptions rest = time;
  rest.end -= t + (n_done > 0 ? kRounding * step : 0);
  return n_done + (rest.end > 0 ? n_steps(rest, step) : 0);
}

}  // namespace testbed::meshing
