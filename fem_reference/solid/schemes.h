// Schemes by which the reference steps in time, by name.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "fem_reference/solid/dynamics.h"
#include "meshing/scene/scene.h"

namespace testbed::fem {

using MakeIntegrator = std::unique_ptr<Integrator>(Dynamics system, double h,
                                                   const ReferenceOptions& options);
/// Longest stable step of small motions about rest (s).
using LongestStep = double(const Dynamics& system);

/// What there is to know of a scheme before it steps.
struct Scheme {
  std::string name;          ///< of reference.integrator
  bool has_spectral_radius;  ///< reference.spectral_radius is its parameter
  LongestStep*
      longest_step;  ///< of an explicit scheme, whose mass is lumped; null: steps of any length are stable
  MakeIntegrator* make;
  bool is_explicit() const { return longest_step != nullptr; }
};

/// Every scheme there is.
const std::vector<Scheme>& schemes();

/// @throws std::runtime_error listing the known names.
const Scheme& find_scheme(const std::string& name);

/// That the scene's scheme is known and has the parameters that are given.
/// @param file  of the scene, for the message
/// @throws std::runtime_error naming file, key, value found and what is expected.
void check_scheme(const Scene& scene, const std::string& file);

}  // namespace testbed::fem
