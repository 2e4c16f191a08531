#include "meshing/surface_energies/near_pairs.h"

#include <CGAL/box_intersection_d.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <vector>

#include "meshing/base/geometry.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/// Parameters of the nearest points of segments ab and cd [Ericson 2005, 5.1.9].
std::pair<double, double> nearest_of_segments(const Vector3d& a, const Vector3d& b, const Vector3d& c,
                                              const Vector3d& d) {
  constexpr double kParallel = 1e-14;  // squared sine, below which it is rounding
  const Vector3d u = b - a, v = d - c, r = a - c;
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v), ur = u.dot(r), vr = v.dot(r);
  const auto part = [](double x) { return std::clamp(x, 0.0, 1.0); };
  if (!(uu > 0 && vv > 0)) return {0, vv > 0 ? part(vr / vv) : 0};
  const double det = uu * vv - uv * uv;
  double s = det > kParallel * uu * vv ? part((uv * vr - ur * vv) / det) : 0;
  double t = (uv * s + vr) / vv;
  if (t < 0 || t > 1) {
    t = part(t);
    s = part((uv * t - ur) / uu);
  }
  return {s, t};
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

bool share_a_node(const PairNodes& node) {
  for (int k = 0; k < 4; ++k)
    for (int l = 0; l < k; ++l)
      if (node[k] == node[l]) return true;
  return false;
}

}  // namespace

NearestPoints nearest_points(const PairNodes& node, bool is_edges, const Matrix3Xd& x) {
  const Vector3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]), d = x.col(node[3]);
  NearestPoints nearest{{}, Eigen::Matrix<double, 4, 2>::Zero(), 0};
  const auto slide = [&](int from, int to) {
    nearest.slides(from, nearest.n_slides) = 1;
    nearest.slides(to, nearest.n_slides++) = -1;
  };
  if (is_edges) {
    const auto [s, t] = nearest_of_segments(a, b, c, d);
    nearest.weight = {1 - s, s, t - 1, -t};
    if (s > 0 && s < 1) slide(1, 0);
    if (t > 0 && t < 1) slide(2, 3);
    return nearest;
  }
  const OnTriangle on = nearest_on_triangle(a, b, c, d);
  nearest.weight = {1, -on.weights[0], -on.weights[1], -on.weights[2]};
  if (on.feature < 0) {
    slide(1, 2);
    slide(1, 3);
  } else if (on.feature < 3) {
    slide(1 + on.feature, 1 + (on.feature + 1) % 3);
  }
  return nearest;
}

Vector3d between(const PairNodes& node, const PairWeights& w, const Matrix3Xd& x) {
  return w[0] * x.col(node[0]) + w[1] * x.col(node[1]) + w[2] * x.col(node[2]) + w[3] * x.col(node[3]);
}

double least_cross(const PairNodes& node, const Matrix3Xd& X) {
  constexpr double kParallel = 1e-2;  // squared sine, of the edges at rest
  return kParallel * (X.col(node[1]) - X.col(node[0])).squaredNorm() *
         (X.col(node[3]) - X.col(node[2])).squaredNorm();
}

Smoothing smoothing_of_edges(const PairNodes& node, const Matrix3Xd& x, double least) {
  Smoothing smoothing;
  const Vector3d u = x.col(node[1]) - x.col(node[0]), v = x.col(node[3]) - x.col(node[2]), cross = u.cross(v);
  const double q = cross.squaredNorm() / least;
  if (q >= 1) return smoothing;
  smoothing.m = (2 - q) * q;
  const double dm = 2 * (1 - q) / least, ddm = -2 / (least * least);  // by the squared cross product
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), uv = u.dot(v);
  const Matrix3d I = Matrix3d::Identity(), by_uu = 2 * (vv * I - v * v.transpose()),
                 by_vv = 2 * (uu * I - u * u.transpose()),
                 by_uv = 4 * u * v.transpose() - 2 * v * u.transpose() - 2 * uv * I;
  Eigen::Matrix<double, 12, 1> by_nodes;  // of the squared cross product
  const Vector3d by_u = 2 * v.cross(cross), by_v = 2 * cross.cross(u);
  by_nodes << -by_u, by_u, -by_v, by_v;
  smoothing.gradient = dm * by_nodes;
  auto& H = smoothing.hessian;
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b) {
      const double sign = (a % 2 == b % 2) ? 1 : -1;
      const Matrix3d block = a < 2 ? (b < 2 ? by_uu : by_uv) : (b < 2 ? Matrix3d(by_uv.transpose()) : by_vv);
      H.block<3, 3>(3 * a, 3 * b) = sign * dm * block;
    }
  H += ddm * by_nodes * by_nodes.transpose();
  return smoothing;
}

void for_each_candidate(const Eigen::VectorXi& vertices, const Eigen::Matrix2Xi& edges,
                        const Eigen::Matrix3Xi& F, const Matrix3Xd& x, double gap,
                        const std::function<void(const PairNodes& node, bool is_edges)>& visit) {
  std::vector<BoundingBox> points = boxes_of(vertices.transpose(), x, gap / 2),
                           triangles = boxes_of(F, x, gap / 2), segments = boxes_of(edges, x, gap / 2);
  const auto add = [&](const PairNodes& node, bool is_edges) {
    if (!share_a_node(node)) visit(node, is_edges);
  };
  CGAL::box_intersection_d(points.begin(), points.end(), triangles.begin(), triangles.end(),
                           [&](const BoundingBox& v, const BoundingBox& t) {
                             const auto f = F.col(t.info());
                             add({vertices(v.info()), f(0), f(1), f(2)}, false);
                           });
  CGAL::box_self_intersection_d(
      segments.begin(), segments.end(), [&](const BoundingBox& a, const BoundingBox& b) {
        const auto [first, second] = std::minmax<int>({a.info(), b.info()});
        add({edges(0, first), edges(1, first), edges(0, second), edges(1, second)}, true);
      });
}

}  // namespace testbed::meshing
