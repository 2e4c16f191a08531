// Deflation by collapsing rest lengths around pivots [paper 4.4, eq. 8].
#pragma once

#include "massspring/model.h"

namespace testbed {

/// Fall-off w = 1/(1 + d) of each spring, d the distance from the pivot to its segment at positions x, in the
/// box normalised by `scale` (the smallest side of the surface's bounding box at rest, m).
Eigen::VectorXd fall_off(const Eigen::Vector3d& pivot, const Eigen::Matrix2Xi& E, const Eigen::Matrix3Xd& x,
                         double scale);

/// Rest lengths (m) of a static scene at a load factor: r = r_0 prod_pivots (1 - R w s), s growing linearly
/// from 0 at the pivot's start to 1.
Eigen::VectorXd collapsed(const Collapse& collapse, const SpringNetwork& network,
                          const Eigen::VectorXd& rest_length, double load_factor);

/// Rest lengths after h seconds of every pivot that has started: r <- r (1 - R w)^h, so that the result does
/// not hang on the step.
void collapse(const Collapse& collapse, const SpringNetwork& network, State& state, double h);

}  // namespace testbed
