// What a scene asks of the spring models and the integrator that it names.
#pragma once

#include <string>
#include <vector>

#include "massspring/calibrations/calibrate.h"
#include "meshing/scene/scene.h"

namespace testbed::massspring {

/// Why network.estimate and network.target_error do not serve the scene with this model; empty where they do.
std::string why_not_estimated(const Scene& scene, const Calibration& calibration);

/// The scene's own spring model and those of its comparison, each once.
std::vector<std::string> models_of(const Scene& scene);

/// Whether springs of this model can do what the scene asks for.
/// @param model  name among calibrations(), in place of network.calibration
/// @param file  of the scene, for the message
/// @throws std::runtime_error naming file, key, value found and what is expected.
void check_model(const Scene& scene, const std::string& model, const std::string& file);

/// Keys ("network.multiplicity") that differ from their defaults, although none of models_of(scene) reads
/// them, nor the reference. What only the other time.mode reads is not among them: one scene serves both.
/// @throws std::runtime_error as find_calibration and find_integrator.
std::vector<std::string> unused_keys(const Scene& scene);

}  // namespace testbed::massspring
