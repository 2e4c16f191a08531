// Obstacles that overlap a body as its motion begins.
#pragma once

#include <optional>

#include "meshing/surface_energies/rigid_body.h"

namespace testbed::meshing {

/// Statics whose end is the body pushed out of the obstacles that it may overlap, at the beginning of a scene in time: no
/// load acts, and each of these comes from outside to where it begins. Absent where nothing overlaps.
/// @param obstacles  the scene's
/// @param X  nodes at rest (3 x n, m)
/// @param faces  3 or 6 nodes each
/// @param frame  axes of X, in columns
/// @throws std::runtime_error where no direction leads out of an obstacle: it holds the whole body, or lies within it
std::optional<Scene> without_overlap(const Scene& scene, const std::vector<RigidBody>& obstacles,
                                     const Eigen::Matrix3Xd& X, const Eigen::MatrixXi& faces,
                                     const Eigen::Matrix3d& frame = Eigen::Matrix3d::Identity());

/// By which a body without supports moves as a whole to lie beside them (m), along the axes of X.
/// @throws std::runtime_error as without_overlap, and where it does not lie beside all of them then
Eigen::Vector3d way_beside(const std::vector<RigidBody>& obstacles, const Eigen::Matrix3Xd& X,
                           const Eigen::MatrixXi& faces);

}  // namespace testbed::meshing
