#include "meshing/surface/cut_surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <queue>
#include <set>
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

  /// Makes triangles of one plane Delaunay's, and keeps them so from here on; caps alone where nothing is to be cut.
  void flip_within_planes(const std::vector<std::vector<bool>>& parts) {
    parts_ = &parts;
    const Eigen::Map<const Eigen::Matrix3Xd> X(X_.front().data(), 3, static_cast<Eigen::Index>(X_.size()));
    off_ = kOff * (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).maxCoeff();
    std::vector<Edge> edges;
    for (const auto& [edge, f] : left_of_) edges.push_back(edge);
    flip(std::move(edges), wanted_.empty());
  }

  bool is_flipped() const { return is_flipped_; }

  SurfaceMesh cut() {
    while (!wanted_.empty() && static_cast<int>(X_.size()) < most_) {
      const Edge edge = wanted_.top().second;
      wanted_.pop();
      bisect(edge);
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
  static constexpr double kOff =
      1e-6;  // of the body's size, a corner from the plane of the triangle beside it

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

  /// Height over the longest edge: next to nothing of needles, and of caps, whose third corner lies on that edge.
  double flatness_of(const Eigen::Vector3i& t) const {
    const double longest = std::max({(X_[t[0]] - X_[t[1]]).squaredNorm(), (X_[t[1]] - X_[t[2]]).squaredNorm(),
                                     (X_[t[2]] - X_[t[0]]).squaredNorm()});
    return 2 * area_vector(t).norm() / longest;
  }

  /// Of a triangle at the corner that sees the edge from a to c (rad).
  double angle_at(int corner, int a, int c) const {
    const Eigen::Vector3d to_a = X_[a] - X_[corner], to_c = X_[c] - X_[corner];
    return std::atan2(to_a.cross(to_c).norm(), to_a.dot(to_c));
  }

  /// Whether all vertices that one lies between are in a part.
  bool is_in(const std::vector<bool>& part, const Eigen::Vector3i& corners) const {
    return part[corners[0]] && part[corners[1]] && part[corners[2]];
  }

  /// Whether every part holds the same of the surface when edge bd takes the place of ac, at triangle f.
  bool leaves_parts(int f, int a, int b, int c, int d) const {
    return std::all_of(parts_->begin(), parts_->end(), [&](const std::vector<bool>& part) {
      const bool is_face_in = is_in(part, before_.col(parent_[f]));
      const auto is_edge_in = [&](int v, int w) {
        return is_in(part, between_[v]) && is_in(part, between_[w]);
      };
      return is_edge_in(a, c) == is_face_in && is_edge_in(b, d) == is_face_in;
    });
  }

  /// Flips edges that are not Delaunay's within planes, and those around until none is left [Lawson 1977].
  void flip(std::vector<Edge> edges, bool of_flat_ones_alone) {
    constexpr double kFlat = 1e-4;  // flatness of a triangle without area to speak of, which may change parts
    constexpr double kHalfTurn = 3.14159265358979323846, kTie = 1e-4;  // rad
    constexpr double kAligned = 1e-6;  // of one less the cosine between two normals
    while (!edges.empty()) {
      const int c = edges.back().first, a = edges.back().second;
      edges.pop_back();
      const auto left = left_of_.find({c, a});
      if (left == left_of_.end()) continue;
      const int f = left->second, g = left_of_.at({a, c});
      const double flatness = std::min(flatness_of(F_[f]), flatness_of(F_[g]));
      const bool is_flat = flatness <= kFlat;
      if (of_flat_ones_alone && !is_flat) continue;
      const int b = F_[f].sum() - a - c, d = F_[g].sum() - a - c;
      if (angle_at(b, a, c) + angle_at(d, a, c) < kHalfTurn + kTie) continue;
      const Eigen::Vector3d of_f = area_vector(F_[f]), of_g = area_vector(F_[g]);
      const bool is_f_larger = of_f.norm() > of_g.norm();
      const Eigen::Vector3d normal = (is_f_larger ? of_f : of_g).normalized();
      const Eigen::Vector3i first(b, c, d), second(d, a, b);
      const bool is_in_plane = std::abs(normal.dot(X_[is_f_larger ? d : b] - X_[c])) <= off_ &&
                               (is_flat || of_f.dot(of_g) >= (1 - kAligned) * of_f.norm() * of_g.norm());
      const bool is_upright = std::min(area_vector(first).dot(normal), area_vector(second).dot(normal)) > 0;
      if (!is_in_plane || !is_upright || left_of_.count({b, d}) + left_of_.count({d, b}) > 0) continue;
      if (!is_flat && !leaves_parts(f, a, b, c, d)) continue;
      left_of_.erase({a, c});
      left_of_.erase({c, a});
      const Eigen::Vector3d across = normal.cross(X_[a] - X_[c]);  // from the edge into f
      const auto lies_in = [&](const Eigen::Vector3i& t) {
        return (X_[t[0]] + X_[t[1]] + X_[t[2]] - 3 * X_[c]).dot(across) > 0 ? f : g;
      };
      const std::pair<int, double> of_first{parent_[lies_in(first)], longest_[lies_in(first)]},
          of_second{parent_[lies_in(second)], longest_[lies_in(second)]};
      std::tie(parent_[f], longest_[f]) = of_first;
      std::tie(parent_[g], longest_[g]) = of_second;
      set_triangle(f, first);
      set_triangle(g, second);
      edges.insert(edges.end(), {{b, c}, {c, d}, {d, a}, {a, b}});
      is_flipped_ = true;
    }
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

  /// Cuts both triangles of an edge, after those beside it of which it is not the longest. What that flips is not cut.
  void bisect(const Edge& edge) {
    const Edge back{edge.second, edge.first};
    for (const Edge& side : {edge, back})
      while (left_of_.count(side) > 0) {
        const Edge longest = longest_edge(left_of_.at(side));
        if (order_of(longest) == order_of(edge)) break;
        bisect(longest);
      }
    if (left_of_.count(edge) == 0) return;
    const int m = static_cast<int>(X_.size());
    X_.emplace_back((X_[edge.first] + X_[edge.second]) / 2);
    between_.push_back(
        between_halves(between_[edge.first], between_[edge.second], before_.col(parent_[left_of_.at(edge)])));
    std::vector<Edge> around;
    for (const Edge& side : {edge, back}) {
      const auto found = left_of_.find(side);
      const int f = found->second;
      left_of_.erase(found);
      const Eigen::Vector3i t = F_[f];
      const int apex = t.sum() - edge.first - edge.second;
      set_triangle(f, {side.first, m, apex});
      add_triangle({m, side.second, apex}, parent_[f], longest_[f]);
      around.insert(around.end(), {{apex, side.first}, {side.second, apex}});
    }
    if (parts_ != nullptr) flip(std::move(around), false);
  }

  const Eigen::Matrix3Xi& before_;  ///< triangles before any cut
  const int most_;
  const std::vector<std::vector<bool>>* parts_ = nullptr;  ///< of vertices before; flips are allowed
  double off_ = 0;                                         ///< kOff in m
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

Eigen::Vector3i between_halves(const Eigen::Vector3i& a, const Eigen::Vector3i& b,
                               const Eigen::Vector3i& corners) {
  std::set<int> ends(a.begin(), a.end());
  ends.insert(b.begin(), b.end());
  return ends.size() == 2 ? Eigen::Vector3i(*ends.begin(), *ends.rbegin(), *ends.begin()) : corners;
}

CutSurface cut_across(const SurfaceMesh& surface, double across, double coarser,
                      const std::vector<std::vector<bool>>& parts) {
  constexpr int kPerVertex = 4, kAlways = 5000;
  if (across == 0) return {surface, false};
  const int most = std::max(kPerVertex * static_cast<int>(surface.X.cols()), kAlways);
  Cutter cutter(surface, coarser * edges_across(surface, across), most);
  cutter.flip_within_planes(parts);
  SurfaceMesh cut = cutter.cut();
  const bool is_bounded = cut.X.cols() >= most;
  if (cut.X.cols() == surface.X.cols() && !cutter.is_flipped()) return {surface, false};
  return {std::move(cut), is_bounded};
}

}  // namespace testbed::meshing
