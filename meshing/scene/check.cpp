#include "meshing/scene/check.h"

#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

void check_scene(const Scene& scene, const std::string& file) {
  const auto expect = [&file](bool is_right, const auto&... words) {
    if (is_right) return;
    std::ostringstream what;
    what << file << ": ";
    (what << ... << words);
    throw std::runtime_error(what.str());
  };
  const bool has_file = !scene.surface.file.empty(), has_shape = !scene.surface.shape.empty();
  expect(has_file != has_shape, "surface.file and surface.shape are both ", has_file ? "given" : "missing",
         ", expected one of them");

  if (scene.material.law == MaterialLaw::SmallStrain) {
    const std::string part = large_strain_part(scene);
    expect(part.empty(), "material.law = small_strain, expected neo_hookean with ", part);
  }

  const bool has_contacts = !scene.obstacles.empty() || scene.self_contact.is_on;
  const TimeOptions& time = scene.time;
  if (time.mode == TimeMode::Static) {
    expect(!has_contacts, "obstacles or self_contact, expected none with time.mode = static");
  } else {
    expect(time.tolerance == 0 || !has_contacts, "time.tolerance = ", time.tolerance,
           ", expected 0 with obstacles or self_contact");
    try {
      if (time.step > 0) n_steps(time, time.step);
    } catch (const std::runtime_error& error) {
      expect(false, error.what());
    }
  }
  if (scene.reference.integrator == ReferenceScheme::CentralDifferences && scene.reference.spectral_radius)
    expect(false, "reference.spectral_radius = ", *scene.reference.spectral_radius,
           ", expected none with reference.integrator = central_differences, which has no such parameter");
  if (scene.skin && scene.skin->relaxation > 0)
    expect(scene.skin->bending > 0, "skin.relaxation = ", scene.skin->relaxation,
           ", expected skin.bending > 0 to drive it");
}

std::string unmodelled_part(const Scene& scene) {
  if (!scene.obstacles.empty() || scene.self_contact.is_on)
    return "obstacles or self_contact: the reference has no contact";
  if (scene.volume || scene.skin) return "volume or skin: the reference is the solid alone";
  if (scene.collapse)
    for (const Pivot& pivot : scene.collapse->pivots)
      if (!pivot.motion.empty() || pivot.end)
        return "collapse.pivots with motion or end: the reference's stay";
  const bool is_static = scene.time.mode == TimeMode::Static;
  if (scene.reference.inertia_relief && (!is_static || law_of(scene) != MaterialLaw::SmallStrain))
    return "reference.inertia_relief: for static scenes at small strain";
  if (is_static) return "";
  if (scene.collapse)
    return "collapse with time.mode = \"dynamic\": the reference collapses in static scenes";
  if (law_of(scene) != MaterialLaw::SmallStrain && scene.material.stiffness_damping > 0)
    return "material.stiffness_damping at finite strain: it would hold back rotations";
  if (scene.reference.integrator == ReferenceScheme::CentralDifferences &&
      scene.material.stiffness_damping > 0)
    return "material.stiffness_damping with reference.integrator = central_differences: explicit steps would "
           "have to be shorter than it";
  return "";
}

}  // namespace testbed::meshing
