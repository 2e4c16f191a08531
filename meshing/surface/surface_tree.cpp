#include "meshing/surface/surface_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "meshing/base/geometry.h"
#include "meshing/surface/surface.h"

namespace testbed::meshing {

namespace {

constexpr int kLeafSize = 4;

bool segment_meets_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Eigen::Vector3d& a,
                            const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const double side_p = orientation(a, b, c, p), side_q = orientation(a, b, c, q);
  if (side_p * side_q > 0 || (side_p == 0 && side_q == 0)) return false;  // in-plane contact is no crossing
  const double u = orientation(p, q, a, b), v = orientation(p, q, b, c), w = orientation(p, q, c, a);
  return (u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0);
}

bool segment_meets_box(const Eigen::Vector3d& p, const Eigen::Vector3d& q, const Eigen::AlignedBox3d& box) {
  double enter = 0, leave = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const double step = q[axis] - p[axis];
    double t0 = (box.min()[axis] - p[axis]) / step, t1 = (box.max()[axis] - p[axis]) / step;
    if (step == 0) {
      if (p[axis] < box.min()[axis] || p[axis] > box.max()[axis]) return false;
      continue;
    }
    if (t0 > t1) std::swap(t0, t1);
    enter = std::max(enter, t0);
    leave = std::min(leave, t1);
  }
  constexpr double kSlack = 1e-12;  // of the segment, for the rounding of the quotients
  return enter <= leave + kSlack;
}

}  // namespace

struct SurfaceTree::Hit {
  double distance2 = std::numeric_limits<double>::infinity();
  OnTriangle at;
  int triangle = -1;
};

SurfaceTree::SurfaceTree(const SurfaceMesh& surface) : surface_(surface), order_(surface.F.cols()) {
  const Eigen::Matrix3Xd& X = surface_.X;
  const Eigen::Matrix3Xi& F = surface_.F;
  std::iota(order_.begin(), order_.end(), 0);
  nodes_.reserve(2 * order_.size() / kLeafSize + 2);
  build(0, static_cast<int>(order_.size()));

  face_normals_ = area_vectors(X, F).colwise().normalized();
  vertex_normals_ = Eigen::Matrix3Xd::Zero(3, X.cols());
  struct HalfEdge {
    int low, high, triangle, corner;
  };
  std::vector<HalfEdge> edges;
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) {
      const int i = F(c, f), j = F((c + 1) % 3, f), k = F((c + 2) % 3, f);
      const Eigen::Vector3d u = X.col(j) - X.col(i), v = X.col(k) - X.col(i);
      vertex_normals_.col(i) += std::atan2(u.cross(v).norm(), u.dot(v)) * face_normals_.col(f);
      edges.push_back({std::min(i, j), std::max(i, j), f, c});
    }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& p, const HalfEdge& q) {
    return std::pair(p.low, p.high) < std::pair(q.low, q.high);
  });
  opposite_.resize(3, F.cols());
  for (size_t e = 0; e + 1 < edges.size(); e += 2) {
    opposite_(edges[e].corner, edges[e].triangle) = edges[e + 1].triangle;
    opposite_(edges[e + 1].corner, edges[e + 1].triangle) = edges[e].triangle;
  }
}

void SurfaceTree::build(int begin, int end) {
  const Eigen::Matrix3Xd& X = surface_.X;
  const Eigen::Matrix3Xi& F = surface_.F;
  const size_t node = nodes_.size();
  nodes_.push_back({{}, begin, end, -1});
  for (int t = begin; t < end; ++t)
    for (int v : F.col(order_[t])) nodes_[node].box.extend(X.col(v));
  if (end - begin <= kLeafSize) return;
  int axis;
  nodes_[node].box.sizes().maxCoeff(&axis);
  const int middle = (begin + end) / 2;
  auto centre = [&, &X = X, &F = F](int t) { return X(axis, F(0, t)) + X(axis, F(1, t)) + X(axis, F(2, t)); };
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                   [&](int s, int t) { return std::pair(centre(s), s) < std::pair(centre(t), t); });
  build(begin, middle);
  nodes_[node].right = static_cast<int>(nodes_.size());
  build(middle, end);
}

SurfaceTree::Hit SurfaceTree::find_nearest(const Eigen::Vector3d& x) const {
  const Eigen::Matrix3Xd& X = surface_.X;
  const Eigen::Matrix3Xi& F = surface_.F;
  Hit best;
  struct Entry {
    double distance2;
    int node;
  };
  Entry stack[128];
  int n = 0;
  stack[n++] = {nodes_[0].box.squaredExteriorDistance(x), 0};
  while (n > 0) {
    const Entry entry = stack[--n];
    if (entry.distance2 >= best.distance2) continue;
    const Node& node = nodes_[entry.node];
    if (node.right < 0) {
      for (int t = node.begin; t < node.end; ++t) {
        const int f = order_[t];
        const OnTriangle at = nearest_on_triangle(x, X.col(F(0, f)), X.col(F(1, f)), X.col(F(2, f)));
        const double distance2 = (x - at.point).squaredNorm();
        if (distance2 < best.distance2) best = {distance2, at, f};
      }
      continue;
    }
    Entry left{nodes_[entry.node + 1].box.squaredExteriorDistance(x), entry.node + 1};
    Entry right{nodes_[node.right].box.squaredExteriorDistance(x), node.right};
    if (left.distance2 < right.distance2) std::swap(left, right);
    stack[n++] = left;  // the nearer one is looked at first
    stack[n++] = right;
  }
  return best;
}

SurfaceTree::Nearest SurfaceTree::nearest(const Eigen::Vector3d& x) const {
  const Hit hit = find_nearest(x);
  return {std::sqrt(hit.distance2), hit.at.point, hit.triangle};
}

double SurfaceTree::depth(const Eigen::Vector3d& x) const {
  const Hit hit = find_nearest(x);
  Eigen::Vector3d normal = face_normals_.col(hit.triangle);
  if (hit.at.feature >= 3)
    normal = vertex_normals_.col(surface_.F(hit.at.feature - 3, hit.triangle));
  else if (hit.at.feature >= 0)
    normal += face_normals_.col(opposite_(hit.at.feature, hit.triangle));
  const double distance = std::sqrt(hit.distance2);
  return (x - hit.at.point).dot(normal) < 0 ? distance : -distance;
}

bool SurfaceTree::crosses(const Eigen::Vector3d& a, const Eigen::Vector3d& b, int at_a, int at_b) const {
  const Eigen::Matrix3Xd& X = surface_.X;
  const Eigen::Matrix3Xi& F = surface_.F;
  int stack[128], n = 0;
  stack[n++] = 0;
  while (n > 0) {
    const int i = stack[--n];
    const Node& node = nodes_[i];
    if (!segment_meets_box(a, b, node.box)) continue;
    if (node.right >= 0) {
      stack[n++] = node.right;
      stack[n++] = i + 1;
      continue;
    }
    for (int t = node.begin; t < node.end; ++t) {
      const auto f = F.col(order_[t]);
      if ((f.array() == at_a || f.array() == at_b).any()) continue;
      if (segment_meets_triangle(a, b, X.col(f[0]), X.col(f[1]), X.col(f[2]))) return true;
    }
  }
  return false;
}

}  // namespace testbed::meshing
