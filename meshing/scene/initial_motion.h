// The velocity with which a body's nodes begin.
#pragma once

#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// Velocity of every node (3 x n, m/s): the sum of the scene's initial motions, as if nothing held the body.
/// @param X     all nodes of the body at rest (3 x n, m)
/// @param mass  lumped at each (n, kg), of which the regions' centres are made
/// @throws std::runtime_error when a region holds no node: names the entry and the body's box.
Eigen::Matrix3Xd initial_velocity(const Scene& scene, const Eigen::Matrix3Xd& X, const Eigen::VectorXd& mass);

}  // namespace testbed::meshing
