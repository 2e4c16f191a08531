// Every tetrahedron as a bag of a target volume [Bourguignon & Cani 2000].
#pragma once

#include "meshing/algebra/block_matrix.h"

namespace testbed::massspring {

/// Penalty on the volume of tetrahedra that fill the body once.
struct LocalVolume {
  double kappa;  ///< Pa
  Eigen::Matrix4Xi T;
  Eigen::VectorXd rest_volume;  ///< V_T0 (m3)
};

/// Energy (J) sum_T 1/2 kappa (V_T - V_T0)^2 / V_T0 [(8)].
double energy(const LocalVolume& local, const Eigen::Matrix3Xd& x);

/// f -= gradient of the energy (N).
void add_forces(const LocalVolume& local, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f);

/// K += sum_T kappa/V_T0 (dV_T/dx)(dV_T/dx)^T (N/m), on and above the diagonal: the Hessian at rest, positive
/// semidefinite everywhere, whatever the curvature.
void add_hessian(const LocalVolume& local, const Eigen::Matrix3Xd& x, BlockMatrix& K,
                 Curvature curvature = Curvature::Projected);

/// Pairs of nodes that share a tetrahedron, 2 x m.
Eigen::Matrix2Xi pairs_of(const LocalVolume& local);

}  // namespace testbed::massspring
