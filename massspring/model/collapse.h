// Deflation by collapsing rest lengths around pivots, and surface relaxation [paper 4.4, eq. 8 and 9].
#pragma once

#include "massspring/model/model.h"

namespace testbed::massspring {

/// Fall-off w = 1/(1 + d) of each spring, d the distance from the pivot to its segment at positions x, in the
/// box normalised by `scale` (the smallest side of the surface's bounding box at rest, m).
Eigen::VectorXd fall_off(const Eigen::Vector3d& pivot, const Eigen::Matrix2Xi& E, const Eigen::Matrix3Xd& x,
                         double scale);

/// The same of each patch of coupled springs, d the distance to its centre of mass.
Eigen::VectorXd fall_off(const Eigen::Vector3d& pivot, const TetSprings& springs, const Eigen::Matrix3Xd& x,
                         double scale);

/// Part of a collapse that each patch of the model's takes: the mean over its volume of collapsing_part, linear
/// in each tetrahedron between nodes.
Eigen::VectorXd collapsing_patches(const Collapse& collapse, const MassSpringModel& model);

/// Sets what a static scene has collapsed to at a load factor: rest lengths and the rest shapes of patches
/// shrink by prod_pivots (1 - R w s), w at rest, s growing linearly from 0 at the pivot's start to 1 at full load,
/// unless the pivot ends before.
void collapse_to(const Collapse& collapse, const MassSpringModel& model, double load_factor, State& state);

/// Collapses rest lengths, and the rest shapes of patches, by every pivot at work at state.t,
/// for h seconds: r <- r (1 - R w)^h [(21)], so that the result does not hang on the step,
/// or per step r <- r (1 - R w). Springs along the surface come first among the model's. The w of patches is times
/// model.collapsing.
void collapse(const Collapse& collapse, const MassSpringModel& model, double h, State& state);

/// Relaxes the springs along the surface's edges, which come first, for h seconds:
/// r_ij <- r_ij (1 - R' (f_i + f_j) / (2 max f))^h [(22)], f_i the mean bending force of the edges at node i.
void relax_surface(double coefficient, const MassSpringModel& model, double h, State& state);

}  // namespace testbed::massspring
