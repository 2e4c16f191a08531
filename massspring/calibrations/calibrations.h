// Independent springs that stand, more or less, for an isotropic solid. Springs alone have nu = 1/4 (Cauchy).
#pragma once

#include "massspring/model/model.h"

namespace testbed::massspring {

/// One stiffness for every spring of the network, scaled to Young's modulus by affine theory: E = sum k r^2 /
/// (6 V) [the paper; (15), (16)]. Poisson's ratio is 1/4 whatever the material says.
void calibrate_uniform(MassSpringModel& model, const Eigen::Matrix2Xi& links);

/// The same scale, but every spring stands for the same volume: k ~ 1/r^2 [(16)].
void calibrate_affine(MassSpringModel& model, const Eigen::Matrix2Xi& links);

/// Springs on the edges of the tetrahedra instead of the network's,
/// k = sum_T 5/2 mu V_T / r^2: the affine stiffness of every tetrahedron that is
/// regular [(17), Van Gelder 1998], and a dilatation term at nodes for nu > 1/4.
void calibrate_van_gelder(MassSpringModel& model, const Eigen::Matrix2Xi& links);

/// As van_gelder with k = sum_T (2 sqrt(2)/25) E_0 a_T and E_0 = 5/2 mu [(17), Lloyd, Szekely & Harders
/// 2007]. The regular tetrahedron of T's volume has the edge a_T.
void calibrate_lloyd(MassSpringModel& model, const Eigen::Matrix2Xi& links);

/// Springs between nodes at most two tetrahedra edges apart, and a dilatation term at nodes for nu > 1/4.
/// Stiffnesses k >= 0 fit the moments that linear and, softly, quadratic fields must balance
/// at every node [(18)].
/// @throws std::runtime_error when no non-negative k fits.
void calibrate_moment(MassSpringModel& model, const Eigen::Matrix2Xi& links);

/// The dilatation term: (lambda - mu)/2 V (div u)^2 [(19)] of small strain, averaged at nodes, on top of springs
/// of shear modulus mu. Poisson's ratio is 1/4 or more.
void add_dilatation(MassSpringModel& model);

/// Springs between the node pairs E (2 x n), in place of the network's.
void set_springs(MassSpringModel& model, const Eigen::Matrix2Xi& E, const Eigen::VectorXd& stiffness);

/// Squared rest lengths of the node pairs (m2).
Eigen::VectorXd squared_lengths(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E);

}  // namespace testbed::massspring
