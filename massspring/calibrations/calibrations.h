// What calibrations of independent springs are made of.
#pragma once

#include "massspring/model/model.h"

namespace testbed::massspring {

/// The dilatation term: (lambda - mu)/2 V (div u)^2 [(19)] of small strain, averaged at nodes, on top of springs
/// of shear modulus mu. Poisson's ratio is 1/4 or more.
void add_dilatation(MassSpringModel& model);

/// Springs between the node pairs E (2 x n), in place of the network's.
void set_springs(MassSpringModel& model, const Eigen::Matrix2Xi& E, const Eigen::VectorXd& stiffness);

/// Squared rest lengths of the node pairs (m2).
Eigen::VectorXd squared_lengths(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E);

}  // namespace testbed::massspring
