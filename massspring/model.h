// The mass-spring solid: what is constant in a run, and what changes.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "massspring/tet_springs.h"
#include "meshing/mesh.h"

namespace testbed {

struct MassSpringModel {
  SpringNetwork network;
  Eigen::VectorXd mass;        ///< kg per node
  Eigen::VectorXd stiffness;   ///< N/m per spring
  double spring_damping = 0;   ///< k_d of every spring (N s/m) [paper eq. 1]
  double mass_damping = 0;     ///< 1/s: force -mass_damping m v
  std::optional<TetSprings> tet_springs;  ///< springs coupled within tetrahedra, where the calibration has them
};

struct State {
  double t = 0;
  Eigen::Matrix3Xd x;           ///< positions (m)
  Eigen::Matrix3Xd v;           ///< velocities (m/s)
  Eigen::VectorXd rest_length;  ///< m per spring
};

}  // namespace testbed
