// The material of a body, the same for both solvers.
#pragma once

#include <optional>

#include "meshing/base/choices.h"

namespace testbed::meshing {

struct Material {
  double E = 1e5;                       ///< Young's modulus (Pa), > 0
  double nu = 0.25;                     ///< Poisson's ratio, in (-1, 0.5)
  double rho = 1000;                    ///< density (kg/m3), > 0
  double damping = 0;                   ///< mass-proportional damping (1/s): force -damping * m * v, >= 0
  double damping_ratio = 0;             ///< of the lowest vibration, over critical, by more of the same, >= 0
  double stiffness_damping = 0;         ///< Rayleigh's other part (s): force -stiffness_damping * K v, >= 0
  std::optional<MaterialLaw> law = {};  ///< absent: what the scene asks for, law_of(scene)
};

}  // namespace testbed::meshing
