#include "fem_reference/solid/schemes.h"

#include <stdexcept>

#include "meshing/base/names.h"
#include "meshing/scene/scene_keys.h"

namespace testbed::fem {

MakeIntegrator make_generalised_alpha, make_minimising_euler, make_central_differences;
LongestStep stable_step;

const std::vector<Scheme>& schemes() {
  static const std::vector<Scheme> kAll{
      {"generalised_alpha", true, nullptr, make_generalised_alpha},
      {"minimising_euler", false, nullptr, make_minimising_euler},
      {"central_differences", false, stable_step, make_central_differences}};
  return kAll;
}

const Scheme& find_scheme(const std::string& name) {
  std::vector<std::string> known;
  for (const Scheme& scheme : schemes()) {
    if (scheme.name == name) return scheme;
    known.push_back(scheme.name);
  }
  throw std::runtime_error("reference.integrator = '" + name + "': no such scheme" + suggestion(name, known));
}

void check_scheme(const Scene& scene, const std::string& file) {
  const auto place = scene.places.find("reference.integrator");
  const std::optional<double> radius = scene.reference.spectral_radius;
  try {
    const Scheme& scheme = find_scheme(scene.reference.integrator);
    if (radius && !scheme.has_spectral_radius)
      throw std::runtime_error("reference.spectral_radius = " + toml_text(*radius) +
                               ", expected none with reference.integrator = " + scheme.name +
                               ", which has no such parameter");
  } catch (const std::runtime_error& error) {
    throw std::runtime_error((place == scene.places.end() ? file : place->second) + ": " + error.what());
  }
}

}  // namespace testbed::fem
