// A body's collapse around pivots [paper eq. 8]: what is left of the length of its fibres.
#pragma once

#include <Eigen/Core>

#include "meshing/base/mesh.h"
#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// Smallest side of the surface's bounding box at rest (m), the unit of distances to pivots.
double shortest_side(const SurfaceMesh& surface);

/// Of a static scene at a load factor and a point at rest (m): the length of a fibre over its first [(2)], which
/// falls linearly with the load factor from each pivot's start to its end.
/// @param part  of the collapse that the point takes [collapsing_part]
double static_length(const Collapse& collapse, double shortest_side, double part, const Eigen::Vector3d& X,
                     double load_factor);

/// Multiplies lengths over their first by what a step of h seconds from t on leaves of them [massspring/README.md (21)], down to
/// collapse.least.
/// @param part    of the collapse that each point takes, n
/// @param x       where the points are, 3 x n (m)
/// @param length  n
void collapse_in_step(const Collapse& collapse, double shortest_side, const Eigen::VectorXd& part,
                      const Eigen::Ref<const Eigen::Matrix3Xd>& x, double t, double h,
                      Eigen::VectorXd& length);

}  // namespace testbed::meshing
