// A pressure that follows the surface as it deforms.
#pragma once

#include <vector>

#include "meshing/surface_energies/enclosed_volume.h"

namespace testbed::meshing {

/// Pressure p (Pa) on the deformed triangles of whole components of the surface: -p A n, the gradient of -p
/// V.
struct FollowerPressure {
  double pressure;
  Eigen::Matrix3Xi F;          ///< corners
  Eigen::Matrix3Xi middles{};  ///< of the edges 01, 12 and 20 where triangles are curved; empty: straight

  /// Nodes of triangle t, 3 or 6.
  Eigen::VectorXi face(Eigen::Index t) const;
};

/// One for each pressure but 0.
/// @param pressure  of each triangle (Pa)
/// @param faces  their nodes, 3 or 6 rows
std::vector<FollowerPressure> followers_of(const Eigen::VectorXd& pressure, const Eigen::MatrixXi& faces);

/// p V (J) at positions x (3 x n, m).
double energy(const FollowerPressure& follower, const Eigen::Matrix3Xd& x);

/// f -= factor times the gradient of the energy (N).
void add_forces(const FollowerPressure& follower, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f,
                double factor = 1);

/// Calls visit(i, j, block) for the blocks (N/m) whose sum is the Hessian of the energy: for each triangle, once
/// for each pair of its nodes.
template <class Visit>
void for_each_hessian_block(const FollowerPressure& follower, const Eigen::Matrix3Xd& x, const Visit& visit) {
  for (Eigen::Index t = 0; t < follower.F.cols(); ++t) {
    const Eigen::VectorXi face = follower.face(t);
    const EnclosedVolume v = enclosed_volume(x(Eigen::all, face));
    for (int a = 0; a < face.size(); ++a)
      for (int b = a; b < face.size(); ++b)
        visit(face(a), face(b), Eigen::Matrix3d(follower.pressure * v.hessian.block<3, 3>(3 * a, 3 * b)));
  }
}

}  // namespace testbed::meshing
