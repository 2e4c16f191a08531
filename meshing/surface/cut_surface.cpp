#include "meshing/surface/cut_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <queue>
#include <tuple>
#include <utility>
#include <vector>

#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {
namespace {

using Edge = std::pair<int, int>;

class Cutter {
 public:
  Cutter(const SurfaceMesh& surface, const Eigen::VectorXd& longest, int most)
      : before_(surface.cuts.F.size() > 0 ? surface.cuts.F : surface.F), most_(most) {
    const bool is_cut = surface.cuts.F.size() > 0;
    for (int v = 0; v < surface.X.cols(); ++v) {
      X_.emplace_back(surface.X.col(v));
      between_.emplace_back(is_cut ? Eigen::Vector3i(surface.cuts.between.col(v)) : Eigen::Vector3i(v, v, v));
    }
    for (int f = 0; f < surface.F.cols(); ++f)
      add_triangle(surface.F.col(f), is_cut ? surface.cuts.parent[f] : f, longest[f]);
  }

  /// Triangles whose third corner lies on their longest edge go to the one beyond it, whose two parts it becomes.
  void flip_caps() {
    constexpr double kFlat = 1e-4;  // height of a triangle over its longest edge
    constexpr double kOff = 1e-6;   // of the body's size, a corner from the plane beyond
    Eigen::Vector3d low = X_.front(), high = low;
    for (const Eigen::Vector3d& x : X_) {
      low = low.cwiseMin(x);
      high = high.cwiseMax(x);
    }
    const double off = kOff * (high - low).maxCoeff();
    std::vector<int> left(F_.size());
    std::iota(left.rbegin(), left.rend(), 0);
    while (!left.empty()) {
      const int f = left.back();
      left.pop_back();
      const double flatness = flatness_of(F_[f]);
      if (flatness > kFlat) continue;
      const auto [c, a] = longest_edge(f);
      const int g = left_of_.at({a, c}), b = F_[f].sum() - a - c, d = F_[g].sum() - a - c;
      const Eigen::Vector3d normal = area_vector(F_[g]).normalized();
      const Eigen::Vector3i first(b, c, d), second(d, a, b);
      const bool is_in_plane = std::abs(normal.dot(X_[b] - X_[c])) <= off;
      const bool is_better = std::min(flatness_of(first), flatness_of(second)) > 2 * flatness;
      const bool is_upright = std::min(area_vector(first).dot(normal), area_vector(second).dot(normal)) > 0;
      if (!is_in_plane || !is_better || !is_upright || left_of_.count({b, d}) + left_of_.count({d, b}) > 0)
        continue;
      left_of_.erase({a, c});
      left_of_.erase({c, a});
      parent_[f] = parent_[g];
      longest_[f] = longest_[g];
      set_triangle(f, first);
      set_triangle(g, second);
      left.push_back(f);
      left.push_back(g);
      is_flipped_ = true;
    }
  }

  bool is_flipped() const { return is_flipped_; }

  SurfaceMesh cut() {
    while (!wanted_.empty() && static_cast<int>(X_.size()) < most_) {
      const Edge edge = wanted_.top().second;
      wanted_.pop();
      if (left_of_.count(edge) > 0) bisect(edge);
    }
    const auto n = static_cast<Eigen::Index>(X_.size()), m = static_cast<Eigen::Index>(F_.size());
    SurfaceMesh result{Eigen::Matrix3Xd(3, n),
                       Eigen::Matrix3Xi(3, m),
                       {before_, Eigen::Matrix3Xi(3, n), Eigen::VectorXi(m)}};
    for (Eigen::Index i = 0; i < n; ++i) {
      result.X.col(i) = X_[i];
      result.cuts.between.col(i) = between_[i];
    }
    for (Eigen::Index f = 0; f < m; ++f) {
      result.F.col(f) = F_[f];
      result.cuts.parent[f] = parent_[f];
    }
    return result;
  }

 private:
  /// Orders edges by length, those of one length by their vertices.
  std::tuple<double, int, int> order_of(const Edge& e) const {
    return {(X_[e.first] - X_[e.second]).norm(), std::max(e.first, e.second), std::min(e.first, e.second)};
  }

  Edge longest_edge(int f) const {
    const Eigen::Vector3i& t = F_[f];
    const Edge edges[] = {{t[0], t[1]}, {t[1], t[2]}, {t[2], t[0]}};
    return *std::max_element(std::begin(edges), std::end(edges),
                             [&](const Edge& a, const Edge& b) { return order_of(a) < order_of(b); });
  }

  Eigen::Vector3d area_vector(const Eigen::Vector3i& t) const {
    return (X_[t[1]] - X_[t[0]]).cross(X_[t[2]] - X_[t[0]]) / 2;
  }

  /// Height over the longest edge.
  double flatness_of(const Eigen::Vector3i& t) const {
    const double longest = std::max({(X_[t[0]] - X_[t[1]]).squaredNorm(), (X_[t[1]] - X_[t[2]]).squaredNorm(),
                                     (X_[t[2]] - X_[t[0]]).squaredNorm()});
    return 2 * area_vector(t).norm() / longest;
  }

  void set_triangle(int f, const Eigen::Vector3i& corners) {
    F_[f] = corners;
    for (int c = 0; c < 3; ++c) {
      const Edge edge{corners[c], corners[(c + 1) % 3]};
      left_of_[edge] = f;
      const double ratio = (X_[edge.first] - X_[edge.second]).norm() / longest_[f];
      if (ratio > 1) wanted_.emplace(ratio, edge);
    }
  }

  void add_triangle(const Eigen::Vector3i& corners, int parent, double longest) {
    F_.emplace_back();
    parent_.push_back(parent);
    longest_.push_back(longest);
    set_triangle(static_cast<int>(F_.size()) - 1, corners);
  }

  /// Cuts both triangles of an edge, after those beside it of which it is not the longest.
  void bisect(const Edge& edge) {
    const Edge back{edge.second, edge.first};
    for (const Edge& side : {edge, back})
      for (Edge longest; order_of(longest = longest_edge(left_of_.at(side))) != order_of(edge);)
        bisect(longest);
    const int m = static_cast<int>(X_.size());
    X_.emplace_back((X_[edge.first] + X_[edge.second]) / 2);
    const Eigen::Vector3i left = before_.col(parent_[left_of_.at(edge)]),
                          right = before_.col(parent_[left_of_.at(back)]);
    between_.push_back(left);
    if (left != right)  // the edge is a part of one that the two triangles shared before
      for (int c = 0; c < 3; ++c)
        if ((right.array() != left[c]).all()) between_.back()[c] = left[(c + 1) % 3];
    for (const Edge& side : {edge, back}) {
      const auto found = left_of_.find(side);
      const int f = found->second;
      left_of_.erase(found);
      const Eigen::Vector3i t = F_[f];
      const int apex = t.sum() - edge.first - edge.second;
      set_triangle(f, {side.first, m, apex});
      add_triangle({m, side.second, apex}, parent_[f], longest_[f]);
    }
  }

  const Eigen::Matrix3Xi& before_;  ///< triangles before any cut
  const int most_;
  std::vector<Eigen::Vector3d> X_;
  std::vector<Eigen::Vector3i> between_, F_;
  std::vector<int> parent_;
  std::vector<double> longest_;  ///< edges wanted of each triangle (m)
  std::map<Edge, int> left_of_;  ///< of directed edges, the triangle
  std::priority_queue<std::pair<double, Edge>> wanted_;
  bool is_flipped_ = false;
};

}  // namespace

Eigen::VectorXd longest_edges(const SurfaceMesh& surface) {
  Eigen::VectorXd longest(surface.F.cols());
  for (Eigen::Index f = 0; f < longest.size(); ++f) {
    const Eigen::Matrix3d x = surface.X(Eigen::all, surface.F.col(f));
    longest[f] =
        std::max({(x.col(0) - x.col(1)).norm(), (x.col(1) - x.col(2)).norm(), (x.col(2) - x.col(0)).norm()});
  }
  return longest;
}

Eigen::VectorXd edges_across(const SurfaceMesh& surface, double across) {
  constexpr double kPerBody = 6 / 1.3;  // edges along a cube of the body's volume
  constexpr double kOff = 1e-6;         // of an edge, from the triangle itself
  constexpr int kHalvings = 8;
  const double largest = std::cbrt(volume(surface.X, surface.F)) / kPerBody;
  const SurfaceTree tree(surface);
  const Eigen::Matrix3Xd inward = -area_vectors(surface.X, surface.F).colwise().normalized();
  Eigen::VectorXd longest = longest_edges(surface);
  for (Eigen::Index f = 0; f < longest.size(); ++f) {
    const Eigen::Vector3d centroid = surface.X(Eigen::all, surface.F.col(f)).rowwise().mean();
    const double edge = longest[f];
    const auto fits = [&](double h) {
      return !tree.crosses(centroid + kOff * edge * inward.col(f), centroid + across * h * inward.col(f));
    };
    double low = 0, high = std::min(edge, largest);
    if (fits(high)) low = high;
    for (int i = 0; i < kHalvings && low < high; ++i)
      (fits((low + high) / 2) ? low : high) = (low + high) / 2;
    longest[f] = high;
  }
  return longest;
}

SurfaceMesh cut_surface(const SurfaceMesh& surface, const Eigen::VectorXd& longest, int most) {
  return Cutter(surface, longest, most).cut();
}

CutSurface cut_across(const SurfaceMesh& surface, double across, double coarser) {
  constexpr int kPerVertex = 4, kAlways = 5000;
  if (across == 0) return {surface, false};
  const int most = std::max(kPerVertex * static_cast<int>(surface.X.cols()), kAlways);
  Cutter cutter(surface, coarser * edges_across(surface, across), most);
  cutter.flip_caps();
  SurfaceMesh cut = cutter.cut();
  const bool is_bounded = cut.X.cols() >= most;
  if (cut.X.cols() == surface.X.cols() && !cutter.is_flipped()) return {surface, false};
  return {std::move(cut), is_bounded};
}

}  // namespace testbed::meshing
