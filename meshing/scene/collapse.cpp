#include "meshing/scene/collapse.h"

#include <algorithm>
#include <cmath>

namespace testbed::meshing {
namespace {

/// What a pivot, where it is at t, depletes at a point: R w [paper eq. 8].
double depletion(const Collapse& collapse, const Pivot& pivot, double t, double shortest_side,
                 const Eigen::Vector3d& x) {
  Eigen::Vector3d centre = pivot.point;
  if (!pivot.motion.empty()) centre += position_at(pivot.motion, t);
  return collapse.coefficient / (1 + (x - centre).norm() / shortest_side);
}

}  // namespace

double shortest_side(const SurfaceMesh& surface) {
  return (surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff()).minCoeff();
}

double static_length(const Collapse& collapse, double shortest_side, double part, const Eigen::Vector3d& X,
                     double load_factor) {
  double length = 1;
  for (const Pivot& pivot : collapse.pivots) {
    const double reached = pivot.end ? std::min(load_factor, *pivot.end) : load_factor;
    if (reached <= pivot.start) continue;
    const double grown = (reached - pivot.start) / (1 - pivot.start);
    length *= 1 - part * grown * depletion(collapse, pivot, reached, shortest_side, X);
  }
  return std::max(length, collapse.least);
}

void collapse_in_step(const Collapse& collapse, double shortest_side, const Eigen::VectorXd& part,
                      const Eigen::Ref<const Eigen::Matrix3Xd>& x, double t, double h,
                      Eigen::VectorXd& length) {
  for (const Pivot& pivot : collapse.pivots) {
    if (t < pivot.start || (pivot.end && t >= *pivot.end)) continue;
    for (Eigen::Index i = 0; i < length.size(); ++i) {
      const double left = 1 - part(i) * depletion(collapse, pivot, t, shortest_side, x.col(i));
      length(i) = std::max(length(i) * std::pow(left, collapse.is_per_step ? 1 : h), collapse.least);
    }
  }
}

}  // namespace testbed::meshing
