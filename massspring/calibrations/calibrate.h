// Spring models by name: from a network and a material to masses and stiffnesses.
#pragma once

#include <string>
#include <vector>

#include "massspring/model/model.h"

namespace testbed::massspring {

struct Calibration {
  std::string name;
  bool needs_tetrahedra;
  bool needs_links;             ///< joins nodes by the network's own springs
  bool is_coupled;              ///< its springs resist together, tetrahedron by tetrahedron
  double least_nu, largest_nu;  ///< Poisson's ratios that it accepts
  void (*set_stiffness)(
      MassSpringModel& model);  ///< fills springs and tet_springs of a model with its network
};

/// Every spring model there is.
const std::vector<Calibration>& calibrations();

/// @throws std::runtime_error listing the known names.
const Calibration& find_calibration(const std::string& name);

/// @throws std::runtime_error for a Poisson's ratio that springs of this calibration refuse.
void check_material(const Material& material, const Calibration& calibration);

/// What coupled springs and the links beside them stand for.
struct MaterialShares {
  Material coupled, linked;
};

/// Links take a share of the shear modulus mu and, as springs do, as much of lambda.
/// @throws std::runtime_error for springs that are not coupled, a share that takes more than lambda, or as
/// check_material.
MaterialShares divide_material(const Material& material, const Calibration& calibration, double share);

/// The mass-spring solid that stands for `material` on `network` (with tetrahedra where the calibration needs
/// them). The model's springs may differ from the network's, and follow another order.
/// @throws std::runtime_error when tetrahedra are missing or the calibration refuses material or network.
MassSpringModel calibrate(const SpringNetwork& network, const Material& material,
                          const Calibration& calibration);

/// The same with coupled springs, whose network's links, all of one stiffness, stand beside them for a share
/// of the shear modulus mu and, as springs do, as much of lambda.
/// @throws std::runtime_error as calibrate and divide_material.
MassSpringModel calibrate_with_links(const SpringNetwork& network, const Material& material,
                                     const Calibration& calibration, double share);

}  // namespace testbed::massspring
