// Spring models by name: from a network and a material to masses and stiffnesses.
#pragma once

#include <string>
#include <vector>

#include "massspring/model/model.h"

namespace testbed::massspring {

/// Fills springs and tet_springs of a model that has its nodes, and links (2 x n) where they are needed.
using SetStiffness = void(MassSpringModel& model, const Eigen::Matrix2Xi& links);

struct Calibration {
  std::string name;
  bool needs_links;  ///< springs are those that join the nodes of the network
  bool needs_tetrahedra;
  bool is_coupled;              ///< its springs resist together, patch by patch
  double least_nu, largest_nu;  ///< Poisson's ratios that it accepts
  SetStiffness* set_stiffness;
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
/// @throws std::runtime_error as check_material, for springs that are not coupled, or a share that takes more
/// than lambda.
MaterialShares divide_material(const Material& material, const Calibration& calibration, double share);

/// The mass-spring solid that stands for `material` on `network`, which has links and tetrahedra where the
/// calibration needs them. Coupled springs know the nodes that supports will hold. The model's springs follow an order of their own.
/// @throws std::runtime_error when links or tetrahedra are missing or the calibration refuses the material.
MassSpringModel calibrate(const SpringNetwork& network, const Material& material,
                          const Calibration& calibration, const std::vector<int>& constrained = {});

/// The same with coupled springs, beside which the network's links stand, all of one stiffness.
/// @throws std::runtime_error as calibrate and divide_material.
MassSpringModel calibrate_with_links(const SpringNetwork& network, const Material& material,
                                     const Calibration& calibration, double share,
                                     const std::vector<int>& constrained = {});

}  // namespace testbed::massspring
