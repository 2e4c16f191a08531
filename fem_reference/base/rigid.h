// Rigid motions of a body's points.
#pragma once

#include <Eigen/Core>

namespace testbed::fem {

/// The six rigid motions of the points about their mean, scaled to
/// order 1, over 3 i + c: shifts along x, y, z, turns about x, y, z.
Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X);

}  // namespace testbed::fem
