#include "meshing/surface_energies/self_contact.h"

#include <algorithm>

#include "meshing/surface/surface.h"

namespace testbed::meshing {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

SurfaceContact::SurfaceContact(const Matrix3Xd& X, const Eigen::Matrix3Xi& F, double E, double thickness)
    : X_(X), F_(F), E_(edges_of(F)), thickness_(thickness) {
  double length = 0;
  for (const auto& e : E_.colwise()) length += (X_.col(e(0)) - X_.col(e(1))).norm() / E_.cols();
  stiffness_ = E * length;
  margin_ = length / 2;
}

std::shared_ptr<SurfaceMemory> SurfaceContact::find_pairs(const Matrix3Xd& x) const {
  const std::vector<Pair>& before = memory_->pairs;
  std::vector<Pair> pairs;
  const auto order = [](const Pair& a, const Pair& b) {
    return std::pair(a.is_edges, a.node) < std::pair(b.is_edges, b.node);
  };
  const Eigen::VectorXi vertices = Eigen::VectorXi::LinSpaced(F_.maxCoeff() + 1, 0, F_.maxCoeff());
  for_each_candidate(vertices, E_, F_, x, thickness_ + margin_, [&](const PairNodes& node, bool is_edges) {
    const auto way = [&](const Matrix3Xd& at) {
      return between(node, nearest_points(node, is_edges, at).weight, at);
    };
    if (way(X_).norm() < 2 * thickness_) return;
    Pair pair{node, is_edges, Vector3d::Zero()};
    const auto known = std::lower_bound(before.begin(), before.end(), pair, order);
    if (known != before.end() && !order(pair, *known))
      pair.side = known->side;
    else
      pair.side = way(x).normalized();
    pairs.push_back(pair);
  });
  std::sort(pairs.begin(), pairs.end(), order);  // CGAL's order is not the same everywhere
  return std::make_shared<SurfaceMemory>(SurfaceMemory{x, std::move(pairs), {}});
}

void SurfaceContact::begin_step(double, double, const Matrix3Xd& x) {
  const Matrix3Xd& listed = memory_->listed;
  const bool is_new = listed.cols() == 0 || (x - listed).colwise().norm().maxCoeff() > margin_ / 4;
  const auto memory = is_new ? find_pairs(x) : std::make_shared<SurfaceMemory>(*memory_);
  for (Pair& pair : memory->pairs) {
    const Vector3d e = between(pair.node, nearest_points(pair.node, pair.is_edges, x).weight, x);
    if (e.dot(pair.side) > 0) pair.side = e.normalized();
  }
  memory_ = memory;
}

/// Calls visit(pair, weights, normal, D - d) for every pair closer than the thickness.
template <class Visit>
void SurfaceContact::for_each_near(const Matrix3Xd& x, const Visit& visit) const {
  for (const Pair& pair : memory_->pairs) {
    const PairWeights w = nearest_points(pair.node, pair.is_edges, x).weight;
    const Vector3d e = between(pair.node, w, x);
    const double length = e.norm();
    const bool has_passed = e.dot(pair.side) < 0;
    if ((length >= thickness_ && !has_passed) || length >= thickness_ + margin_) continue;
    const double d = has_passed ? -length : length;
    visit(pair, w, length > 0 ? Vector3d(e / d) : pair.side, thickness_ - d);
  }
}

double SurfaceContact::energy(const Matrix3Xd& x) const {
  double sum = 0;
  for_each_near(x, [&](const Pair& pair, const PairWeights&, const Vector3d&, double excess) {
    sum += smoothing_of(pair, x).m * stiffness_ / 2 * excess * excess;
  });
  return sum;
}

void SurfaceContact::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for_each_near(x, [&](const Pair& pair, const PairWeights& w, const Vector3d& n, double excess) {
    const Smoothing smoothing = smoothing_of(pair, x);
    for (int k = 0; k < 4; ++k)
      f.col(pair.node[k]) += smoothing.m * stiffness_ * excess * w[k] * n -
                             stiffness_ / 2 * excess * excess * smoothing.gradient.segment<3>(3 * k);
  });
}

void SurfaceContact::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature) const {
  for_each_near(x, [&](const Pair& pair, const PairWeights& w, const Vector3d& n, double) {
    H.pairs.push_back({pair.node, w, n, smoothing_of(pair, x).m * stiffness_});
  });
}

Smoothing SurfaceContact::smoothing_of(const Pair& pair, const Matrix3Xd& x) const {
  return pair.is_edges ? smoothing_of_edges(pair.node, x, least_cross(pair.node, X_)) : Smoothing();
}

}  // namespace testbed::meshing
