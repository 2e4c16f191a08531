#include "massspring/model/collapse.h"

#include <algorithm>
#include <cmath>

namespace testbed::massspring {
namespace {

double box_scale(const TetMesh& network) {
  const auto surface = network.X.leftCols(network.n_surface);
  return (surface.rowwise().maxCoeff() - surface.rowwise().minCoeff()).minCoeff();
}

/// Multiplies lengths by shrink(w) around a pivot, down to the least.
template <class Shrink>
void shrink_around(const Eigen::Vector3d& pivot, const Collapse& collapse, const MassSpringModel& model,
                   const Eigen::Matrix3Xd& x, const State& rest, const Shrink& shrink, State& state) {
  const double least = collapse.least;
  const double scale = box_scale(model.network);
  if (model.springs) {
    const Eigen::Index n_kept = collapse.surface ? 0 : model.network.F.cols() * 3 / 2;
    const Eigen::Index n = model.springs->E.cols() - n_kept;
    const Eigen::ArrayXd w = fall_off(pivot, model.springs->E.rightCols(n), x, scale);
    state.rest_length.segment(n_kept, n) = (state.rest_length.segment(n_kept, n).array() * shrink(w))
                                               .max(least * rest.rest_length.segment(n_kept, n).array());
  }
  if (model.tet_springs) {
    Eigen::ArrayXd w = fall_off(pivot, *model.tet_springs, x, scale);
    if (model.collapsing.size() > 0) w *= model.collapsing.array();
    if (state.patch_scale.size() == 0) state.patch_scale = Eigen::VectorXd::Ones(w.size());
    state.patch_scale = (state.patch_scale.array() * shrink(w)).max(least);
  }
}

Eigen::Vector3d at_time(const Pivot& pivot, double t) {
  return pivot.motion.empty() ? pivot.point : pivot.point + position_at(pivot.motion, t);
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

Eigen::VectorXd fall_off(const Eigen::Vector3d& pivot, const TetSprings& springs, const Eigen::Matrix3Xd& x,
                         double scale) {
  Eigen::VectorXd w(springs.n_patches());
  for (int p = 0; p < springs.n_patches(); ++p) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
      centre += springs.weight[e] * x.col(springs.node[e]);
    w(p) = 1 / (1 + (centre - pivot).norm() / scale);
  }
  return w;
}

Eigen::VectorXd collapsing_patches(const Collapse& collapse, const MassSpringModel& model) {
  const auto part_at = collapsing_part(collapse, surface_of(model));
  const Eigen::Matrix3Xd& X = model.network.X;
  Eigen::VectorXd of_node(X.cols());
  for (Eigen::Index i = 0; i < X.cols(); ++i) of_node(i) = part_at(X.col(i));
  const TetSprings& springs = *model.tet_springs;
  Eigen::VectorXd part = Eigen::VectorXd::Zero(springs.n_patches());
  for (int p = 0; p < springs.n_patches(); ++p)
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
      part(p) += springs.weight[e] * of_node(springs.node[e]);
  return part;
}

void collapse_to(const Collapse& collapse, const MassSpringModel& model, double load_factor, State& state) {
  const State rest = initial_state(model);
  state.rest_length = rest.rest_length;
  state.patch_scale = rest.patch_scale;
  for (const Pivot& pivot : collapse.pivots) {
    const double reached = std::min(load_factor, pivot.end.value_or(1));
    if (reached <= pivot.start) continue;
    const double s = (reached - pivot.start) / (1 - pivot.start);
    shrink_around(
        at_time(pivot, reached), collapse, model, model.network.X, rest,
        [&](const Eigen::ArrayXd& w) -> Eigen::ArrayXd { return 1 - collapse.coefficient * s * w; }, state);
  }
}

void collapse(const Collapse& collapse, const MassSpringModel& model, double h, State& state) {
  const State rest = initial_state(model);
  for (const Pivot& pivot : collapse.pivots) {
    if (state.t < pivot.start || (pivot.end && state.t >= *pivot.end)) continue;
    const double exponent = collapse.is_per_step ? 1 : h;
    shrink_around(
        at_time(pivot, state.t), collapse, model, state.x, rest,
        [&](const Eigen::ArrayXd& w) -> Eigen::ArrayXd {
          return (1 - collapse.coefficient * w).pow(exponent);
        },
        state);
  }
}

void relax_surface(double coefficient, const MassSpringModel& model, double h, State& state) {
  const Eigen::Index n_edges = model.network.F.cols() * 3 / 2;  // of the surface, which come first
  relax(*model.bending, model.springs->E.leftCols(n_edges), coefficient, h, state.x,
        state.rest_length.head(n_edges));
}

}  // namespace testbed::massspring
