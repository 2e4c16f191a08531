#include "meshing/surface_energies/self_contact.h"

#include <CGAL/box_intersection_d.h>

#include <Eigen/Geometry>
#include <algorithm>

#include "meshing/base/geometry.h"
#include "meshing/surface/surface.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Weights = std::array<double, 4>;

/// Parameters of the nearest points of segments ab and cd [Ericson 2005, 5.1.9].
std::pair<double, double> nearest_of_segments(const Vector3d& a, const Vector3d& b, const Vector3d& c,
                                              const Vector3d& d) {
  const Vector3d u = b - a, v = d - c, r = a - c;
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v), ur = u.dot(r), vr = v.dot(r);
  const auto part = [](double x) { return std::clamp(x, 0.0, 1.0); };
  if (!(uu > 0 && vv > 0)) return {0, vv > 0 ? part(vr / vv) : 0};
  const double det = uu * vv - uv * uv;
  double s = det > 0 ? part((uv * vr - ur * vv) / det) : 0;
  double t = (uv * s + vr) / vv;
  if (t < 0 || t > 1) {
    t = part(t);
    s = part((uv * t - ur) / uu);
  }
  return {s, t};
}

Weights nearest(const std::array<int, 4>& node, bool is_edges, const Matrix3Xd& x) {
  const Vector3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]), d = x.col(node[3]);
  if (is_edges) {
    const auto [s, t] = nearest_of_segments(a, b, c, d);
    return {1 - s, s, t - 1, -t};
  }
  const Vector3d w = nearest_on_triangle(a, b, c, d).weights;
  return {1, -w[0], -w[1], -w[2]};
}

Vector3d between(const std::array<int, 4>& node, const Weights& w, const Matrix3Xd& x) {
  return w[0] * x.col(node[0]) + w[1] * x.col(node[1]) + w[2] * x.col(node[2]) + w[3] * x.col(node[3]);
}

using BoundingBox = CGAL::Box_intersection_d::Box_with_info_d<double, 3, int>;

template <class Nodes>
std::vector<BoundingBox> boxes_of(const Nodes& parts, const Matrix3Xd& x, double reach) {
  std::vector<BoundingBox> boxes;
  for (Eigen::Index p = 0; p < parts.cols(); ++p) {
    Vector3d low = x.col(parts(0, p)), high = low;
    for (Eigen::Index k = 1; k < parts.rows(); ++k) {
      low = low.cwiseMin(x.col(parts(k, p)));
      high = high.cwiseMax(x.col(parts(k, p)));
    }
    low.array() -= reach;
    high.array() += reach;
    boxes.emplace_back(low.data(), high.data(), static_cast<int>(p));
  }
  return boxes;
}

}  // namespace

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
  const auto add = [&](const std::array<int, 4>& node, bool is_edges) {
    for (int k = 0; k < 4; ++k)
      for (int l = 0; l < k; ++l)
        if (node[k] == node[l]) return;
    if (between(node, nearest(node, is_edges, X_), X_).norm() < 2 * thickness_) return;
    Pair pair{node, is_edges, Vector3d::Zero()};
    const auto known = std::lower_bound(before.begin(), before.end(), pair, order);
    if (known != before.end() && !order(pair, *known))
      pair.side = known->side;
    else
      pair.side = between(node, nearest(node, is_edges, x), x).normalized();
    pairs.push_back(pair);
  };
  const double reach = (thickness_ + margin_) / 2;
  const Eigen::RowVectorXi vertices = Eigen::RowVectorXi::LinSpaced(F_.maxCoeff() + 1, 0, F_.maxCoeff());
  std::vector<BoundingBox> points = boxes_of(vertices, x, reach), triangles = boxes_of(F_, x, reach),
                           edges = boxes_of(E_, x, reach);
  CGAL::box_intersection_d(points.begin(), points.end(), triangles.begin(), triangles.end(),
                           [&](const BoundingBox& v, const BoundingBox& t) {
                             const auto f = F_.col(t.info());
                             add({v.info(), f(0), f(1), f(2)}, false);
                           });
  CGAL::box_self_intersection_d(edges.begin(), edges.end(), [&](const BoundingBox& a, const BoundingBox& b) {
    const auto [first, second] = std::minmax<int>({a.info(), b.info()});
    add({E_(0, first), E_(1, first), E_(0, second), E_(1, second)}, true);
  });
  std::sort(pairs.begin(), pairs.end(), order);  // CGAL's order is not the same everywhere
  return std::make_shared<SurfaceMemory>(SurfaceMemory{x, std::move(pairs)});
}

void SurfaceContact::begin_step(double, double, const Matrix3Xd& x) {
  const Matrix3Xd& listed = memory_->listed;
  const bool is_new = listed.cols() == 0 || (x - listed).colwise().norm().maxCoeff() > margin_ / 4;
  const auto memory = is_new ? find_pairs(x) : std::make_shared<SurfaceMemory>(*memory_);
  for (Pair& pair : memory->pairs) {
    const Vector3d e = between(pair.node, nearest(pair.node, pair.is_edges, x), x);
    if (e.dot(pair.side) > 0) pair.side = e.normalized();
  }
  memory_ = memory;
}

/// Calls visit(pair, weights, normal, D - d) for every pair closer than the thickness.
template <class Visit>
void SurfaceContact::for_each_near(const Matrix3Xd& x, const Visit& visit) const {
  for (const Pair& pair : memory_->pairs) {
    const Weights w = nearest(pair.node, pair.is_edges, x);
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
  for_each_near(x, [&](const Pair& pair, const Weights&, const Vector3d&, double excess) {
    sum += smoothing_of(pair, x).m * stiffness_ / 2 * excess * excess;
  });
  return sum;
}

void SurfaceContact::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for_each_near(x, [&](const Pair& pair, const Weights& w, const Vector3d& n, double excess) {
    const Smoothing smoothing = smoothing_of(pair, x);
    for (int k = 0; k < 4; ++k) f.col(pair.node[k]) += smoothing.m * stiffness_ * excess * w[k] * n;
    const double push = stiffness_ / 2 * excess * excess;
    f.col(pair.node[0]) += push * smoothing.by_u;
    f.col(pair.node[1]) -= push * smoothing.by_u;
    f.col(pair.node[2]) += push * smoothing.by_v;
    f.col(pair.node[3]) -= push * smoothing.by_v;
  });
}

void SurfaceContact::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature) const {
  for_each_near(x, [&](const Pair& pair, const Weights& w, const Vector3d& n, double) {
    H.pairs.push_back({pair.node, w, n, smoothing_of(pair, x).m * stiffness_});
  });
}

SurfaceContact::Smoothing SurfaceContact::smoothing_of(const Pair& pair, const Matrix3Xd& x) const {
  constexpr double kParallel = 1e-2;  // squared sine, of the edges at rest
  Smoothing smoothing{1, Vector3d::Zero(), Vector3d::Zero()};
  if (!pair.is_edges) return smoothing;
  const auto edge = [&](const Matrix3Xd& at, int first) -> Vector3d {
    return at.col(pair.node[first + 1]) - at.col(pair.node[first]);
  };
  const Vector3d u = edge(x, 0), v = edge(x, 2), cross = u.cross(v);
  const double least = kParallel * edge(X_, 0).squaredNorm() * edge(X_, 2).squaredNorm();
  const double q = cross.squaredNorm() / least;
  if (q >= 1) return smoothing;
  const double dm = 2 * (1 - q) / least;  // by the squared cross product
  return {(2 - q) * q, 2 * dm * v.cross(cross), 2 * dm * cross.cross(u)};
}

}  // namespace testbed::meshing
