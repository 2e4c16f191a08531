// A box whose one end rolls, shared by the tests of both solvers.
#pragma once

#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// A scene on a box from x = 0 to 1 m that is clamped at one end. The other rolls: its
/// nodes move across `constrained`, or with `is_axis` along it.
inline Scene rolling(const Scene& scene, const Eigen::Matrix3d& turn, const Eigen::Vector3d& constrained,
                     bool is_axis) {
  Scene rolling = scene;
  rolling.initial.clear();
  rolling.gravity = turn * Eigen::Vector3d(1, -2, -9);
  Support clamp, roller;
  clamp.region.shape = HalfSpace{turn * Eigen::Vector3d(0.05, 0, 0), turn * Eigen::Vector3d(1, 0, 0)};
  roller.region.shape = HalfSpace{turn * Eigen::Vector3d(0.95, 0, 0), turn * Eigen::Vector3d(-1, 0, 0)};
  (is_axis ? roller.along : roller.normal) = turn * constrained;
  roller.displacement = turn * (is_axis ? Eigen::Vector3d(0.01, 0, 0.01) : Eigen::Vector3d(0, 0, 0.01));
  rolling.supports = {clamp, roller};
  return rolling;
}

}  // namespace testbed::meshing
