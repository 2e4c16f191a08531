// Surface tractions as forces on nodes.
#pragma once

#include <Eigen/Core>
#include <functional>

namespace testbed::massspring {

/// Integral of N_i sigma n dA over the triangles, exact for a stress sigma (Pa) of degree 3 (3 x n, N).
Eigen::Matrix3Xd traction_forces(const std::function<Eigen::Matrix3d(const Eigen::Vector3d&)>& stress,
                                 const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

}  // namespace testbed::massspring
