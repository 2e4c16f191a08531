// The velocity with which a body's nodes begin.
#pragma once

#include <Eigen/Core>
#include <functional>

#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// Velocity of every node (3 x n, m/s): the sum of the scene's initial motions, as if nothing held the body.
/// @param X       nodes of the body at rest (3 x n, m), all or a process' share
/// @param mass    lumped at each (n, kg), of which the regions' centres are made; 0 where other processes count it
/// @param body    the box of all nodes
/// @param add_up  replaces values by their sums over all processes
/// @throws std::runtime_error when a region holds no node: names the entry and the body's box.
Eigen::Matrix3Xd initial_velocity(
    const Scene& scene, const Eigen::Matrix3Xd& X, const Eigen::VectorXd& mass, const Box& body,
    const std::function<void(Eigen::Ref<Eigen::VectorXd>)>& add_up = [](const auto&) {});

}  // namespace testbed::meshing
