#include "massspring/choices/check_model.h"

#include <algorithm>
#include <map>
#include <sstream>
#include <stdexcept>

#include "massspring/time/schemes.h"

namespace testbed::massspring {
namespace {

bool is_dynamic(const Scene& scene) {
  return scene.time.mode == TimeMode::Dynamic;
}

/// Springs that resist on their own, but for those of the skin.
bool has_springs(const Scene& scene, const Calibration& calibration) {
  return !calibration.is_coupled || scene.network.link_share > 0;
}

bool has_skin_springs(const Scene& scene) {
  return scene.skin && scene.skin->stiffness > 0;
}

bool has_links(const Scene& scene, const Calibration& calibration) {
  return calibration.needs_links || scene.network.link_share > 0;
}

void check_skin_and_volume(const Scene& scene, const Calibration& calibration) {
  const auto refuse = [](const char* key, double value, const std::string& expected) {
    std::ostringstream what;
    what << key << " = " << value << ", expected " << expected;
    throw std::runtime_error(what.str());
  };
  if (scene.skin && scene.skin->relaxation > 0 && !has_springs(scene, calibration) &&
      !has_skin_springs(scene))
    refuse("skin.relaxation", scene.skin->relaxation,
           "skin.stiffness > 0 with " + calibration.name + " springs: it shortens springs along the surface");
  if (scene.volume && scene.volume->local > 0 && !calibration.needs_tetrahedra)
    refuse("volume.local", scene.volume->local,
           "0 with " + calibration.name + " springs: their network has no tetrahedra");
  const std::string& integrator = scene.time.integrator;
  const bool holds_volume = integrator == "minimising_euler" || integrator == "bdf2";
  if (is_dynamic(scene) && scene.volume && scene.volume->is_exact && !holds_volume)
    throw std::runtime_error("time.integrator = " + integrator +
                             ", expected minimising_euler or bdf2 with volume.exact");
  if (is_dynamic(scene) && scene.material.stiffness_damping > 0)
    refuse("material.stiffness_damping", scene.material.stiffness_damping, "0: only the reference has it");
}

bool is_estimated(const Scene& scene, const Calibration& calibration) {
  return why_not_estimated(scene, calibration).empty();
}

/// A key that not every model reads, and which do.
struct Reading {
  const char* key;
  bool (*is_read)(const Scene& scene, const Calibration& calibration);
};

bool is_sampled(const Scene& scene, const Calibration&) {
  return scene.network.sampling != "mesher";
}

bool is_projected(const Scene& scene, const Calibration& calibration) {
  const std::string& connectivity = scene.network.connectivity;
  return has_links(scene, calibration) && (connectivity == "pcp" || connectivity == "completed_pcp");
}

bool is_linearised(const Scene& scene, const Calibration&) {
  return !is_dynamic(scene) || find_integrator(scene.time.integrator).is_linearised;
}

const Reading kReadings[] = {
    {"network.phi", is_sampled},
    {"network.psi", is_sampled},
    {"network.k", is_sampled},
    {"network.seed", is_sampled},
    {"network.spacing", [](const Scene& s, const Calibration& c) { return !is_sampled(s, c); }},
    {"network.connectivity", has_links},
    {"network.multiplicity", is_projected},
    {"network.degree_weight", is_projected},
    {"network.depth_weight", is_projected},
    {"network.reading", is_projected},
    {"network.neighbours",
     [](const Scene& s, const Calibration& c) {
       return has_links(s, c) && s.network.connectivity == "completed_pcp";
     }},
    {"network.spring_law",
     [](const Scene& s, const Calibration& c) {
       return has_springs(s, c) && law_of(s) != MaterialLaw::SmallStrain;
     }},
    {"network.spring_damping", has_springs},
    {"network.estimate", is_estimated},
    {"network.target_error", is_estimated},
    {"network.mass",
     [](const Scene& s, const Calibration& c) {
       return c.is_coupled && !(is_dynamic(s) && find_integrator(s.time.integrator).is_explicit);
     }},
    {"collapse.surface",
     [](const Scene& s, const Calibration& c) { return has_springs(s, c) || has_skin_springs(s); }},
    {"self_contact.friction",
     [](const Scene& s, const Calibration&) {
       return s.self_contact.is_on && is_dynamic(s) && find_integrator(s.time.integrator).has_barriers();
     }},
    {"time.volume_gradient", is_linearised},
    {"time.bend_gradient", is_linearised},
    {"time.linear_solver", is_linearised}};

}  // namespace

std::string why_not_estimated(const Scene& scene, const Calibration& calibration) {
  if (is_dynamic(scene)) return "the errors of equilibria alone are estimated";
  if (!calibration.is_coupled || has_links(scene, calibration))
    return "the error of independent springs does not fall as nodes are added";
  if (!scene.seams.empty()) return "stitches tie vertices, and a finer surface has others";
  if (!scene.events.empty()) return "events are obeyed between load steps, and an estimate takes one";
  if (scene.collapse && !scene.collapse->surface && !scene.collapse->depth)
    return "the default of collapse.depth hangs on the triangles";
  return "";
}

std::vector<std::string> models_of(const Scene& scene) {
  std::vector<std::string> models{scene.network.calibration};
  for (const std::string& name : scene.comparison.calibrations)
    if (std::find(models.begin(), models.end(), name) == models.end()) models.push_back(name);
  return models;
}

void check_model(const Scene& scene, const std::string& model, const std::string& file) {
  try {
    const Calibration& calibration = find_calibration(model);
    const Integrator& integrator = find_integrator(scene.time.integrator);
    if (is_dynamic(scene))
      check_contacts(integrator, scene.time.tolerance, !scene.obstacles.empty(), scene.self_contact.is_on);
    if (scene.network.link_share > 0)
      divide_material(scene.material, calibration, scene.network.link_share);
    else
      check_material(scene.material, calibration);
    check_skin_and_volume(scene, calibration);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(file + ": " + error.what());
  }
  for (const Event& event : scene.events) check_model(*event.after, model, file);
}

std::vector<std::string> unused_keys(const Scene& scene) {
  Scene defaults;
  defaults.collapse.emplace();
  std::map<std::string, std::string> values;
  for (const SceneKey& key : keys_of(defaults)) values[key.path] = key.value;
  std::vector<const Calibration*> models;
  for (const std::string& name : models_of(scene)) models.push_back(&find_calibration(name));
  std::vector<std::string> unused;
  for (const SceneKey& key : keys_of(scene)) {
    const auto reading = std::find_if(std::begin(kReadings), std::end(kReadings),
                                      [&](const Reading& r) { return r.key == key.path; });
    if (reading == std::end(kReadings) || key.value == values.at(key.path)) continue;
    if (std::none_of(models.begin(), models.end(),
                     [&](const Calibration* model) { return reading->is_read(scene, *model); }))
      unused.push_back(key.path);
  }
  return unused;
}

}  // namespace testbed::massspring
