#include "massspring/collapse.h"

#include <algorithm>
#include <cmath>

namespace testbed {
namespace {

double box_scale(const SpringNetwork& network) {
  const auto surface = network.X.leftCols(network.n_surface);
  return (surface.rowwise().maxCoeff() - surface.rowwise().minCoeff()).minCoeff();
}

}  // namespace

Eigen::VectorXd fall_off(const Eigen::Vector3d& pivot, const Eigen::Matrix2Xi& E, const Eigen::Matrix3Xd& x,
                         double scale) {
  Eigen::VectorXd w(E.cols());
  for (int s = 0; s < E.cols(); ++s) {
    const Eigen::Vector3d a = x.col(E(0, s)), along = x.col(E(1, s)) - a;
    const double squared = along.squaredNorm();
    const double at = squared > 0 ? std::clamp((pivot - a).dot(along) / squared, 0.0, 1.0) : 0;
    w(s) = 1 / (1 + (a + at * along - pivot).norm() / scale);
  }
  return w;
}

Eigen::VectorXd collapsed(const Collapse& collapse, const SpringNetwork& network,
                          const Eigen::VectorXd& rest_length, double load_factor) {
  Eigen::ArrayXd r = rest_length;
  for (const Pivot& pivot : collapse.pivots)
    if (load_factor > pivot.start) {
      const double s = (load_factor - pivot.start) / (1 - pivot.start);
      r *= 1 -
           collapse.coefficient * s * fall_off(pivot.point, network.E, network.X, box_scale(network)).array();
    }
  return r;
}

void collapse(const Collapse& collapse, const SpringNetwork& network, State& state, double h) {
  for (const Pivot& pivot : collapse.pivots)
    if (state.t >= pivot.start)
      state.rest_length.array() *=
          (1 - collapse.coefficient * fall_off(pivot.point, network.E, state.x, box_scale(network)).array())
              .pow(h);
}

}  // namespace testbed
