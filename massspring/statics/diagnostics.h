// How far a model can be trusted on its mesh, from exact fields: no reference solver needed.
#pragma once

#include <Eigen/Core>

#include "massspring/model/model.h"

namespace testbed::massspring {

struct Diagnostics {
  /// Patch test under uniform pressure: relative L2 displacement error at the surface.
  double pressure_error;
  double uniaxial_error;  ///< the same under uniaxial tension
  double bending_error;   ///< the same under pure bending, where stress is linear
  double torsion_error;
  double bending_compliance;  ///< work of the tractions over the exact work: 1 is exact, less is too stiff
  double torsion_compliance;
  /// Per node: larger error of bending and torsion over the field's largest displacement.
  Eigen::VectorXd node_error;
};

/// Solves the four exact fields with the model as built.
/// @throws std::runtime_error when the model is not positive definite.
Diagnostics diagnose(const MassSpringModel& model);

}  // namespace testbed::massspring
