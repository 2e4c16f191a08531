#include "meshing/surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace testbed {

namespace {

/// A triangle is degenerate when its height is below this fraction of its longest edge: some thousand
/// rounding errors.
constexpr double degenerate_height = 1e-12;

struct HalfEdge {
  int low, high, face;
  bool is_forward;  // runs from low to high
};

std::vector<HalfEdge> sorted_half_edges(const Eigen::Matrix3Xi& F) {
  std::vector<HalfEdge> edges;
  edges.reserve(3 * F.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) {
      const int a = F(c, f), b = F((c + 1) % 3, f);
      edges.push_back({std::min(a, b), std::max(a, b), f, a < b});
    }
  std::sort(edges.begin(), edges.end(), [](const HalfEdge& p, const HalfEdge& q) {
    return std::tie(p.low, p.high, p.face) < std::tie(q.low, q.high, q.face);
  });
  return edges;
}

int find_root(std::vector<int>& parent, int i) {
  while (parent[i] != i) i = parent[i] = parent[parent[i]];
  return i;
}

/// First vertex whose triangles form more than one fan, or -1. Edges must be manifold.
int find_split_vertex(const SurfaceMesh& surface, const std::vector<HalfEdge>& edges) {
  // Corners of one vertex are joined across the edges that they share: as many groups as fans.
  const auto& F = surface.F;
  std::vector<int> parent(3 * F.cols());
  std::iota(parent.begin(), parent.end(), 0);
  auto corner = [&](int face, int vertex) {
    for (int c = 0; c < 3; ++c)
      if (F(c, face) == vertex) return 3 * face + c;
    return -1;
  };
  for (size_t e = 0; e + 1 < edges.size(); e += 2)
    for (int vertex : {edges[e].low, edges[e].high})
      parent[find_root(parent, corner(edges[e].face, vertex))] =
          find_root(parent, corner(edges[e + 1].face, vertex));
  std::vector<int> fan_of(surface.X.cols(), -1);
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) {
      const int root = find_root(parent, 3 * f + c);
      int& fan = fan_of[F(c, f)];
      if (fan >= 0 && fan != root) return F(c, f);
      fan = root;
    }
  return -1;
}

}  // namespace

double volume(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  if (X.cols() == 0) return 0;
  const Eigen::Vector3d centre = X.rowwise().mean();
  double six_volumes = 0;
  for (int f = 0; f < F.cols(); ++f)
    six_volumes += (X.col(F(0, f)) - centre).dot((X.col(F(1, f)) - centre).cross(X.col(F(2, f)) - centre));
  return six_volumes / 6;
}

double area(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  return area_vectors(X, F).colwise().norm().sum();
}

Eigen::Matrix3Xd area_vectors(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  Eigen::Matrix3Xd vectors(3, F.cols());
  for (int f = 0; f < F.cols(); ++f) {
    const Eigen::Vector3d a = X.col(F(0, f)), b = X.col(F(1, f)), c = X.col(F(2, f));
    vectors.col(f) = (b - a).cross(c - a) / 2;
  }
  return vectors;
}

Eigen::VectorXd vertex_areas(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  const Eigen::VectorXd face_areas = area_vectors(X, F).colwise().norm();
  Eigen::VectorXd areas = Eigen::VectorXd::Zero(X.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int v : F.col(f)) areas[v] += face_areas[f] / 3;
  return areas;
}

Eigen::Matrix2Xi edges_of(const Eigen::Matrix3Xi& F) {
  std::vector<std::pair<int, int>> edges;
  edges.reserve(3 * F.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) edges.push_back(std::minmax<int>({F(c, f), F((c + 1) % 3, f)}));
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Eigen::Matrix2Xi E(2, edges.size());
  for (size_t e = 0; e < edges.size(); ++e) E.col(e) << edges[e].first, edges[e].second;
  return E;
}

void check_closed(const SurfaceMesh& surface, const std::string& name) {
  const auto& [X, F] = surface;
  auto fail = [&](auto&&... parts) {
    std::ostringstream text;
    text << name << ": ";
    (text << ... << parts);
    throw std::runtime_error(text.str());
  };
  auto at = [&](int i) {
    std::ostringstream text;
    text << i << " (" << X(0, i) << ", " << X(1, i) << ", " << X(2, i) << ")";
    return text.str();
  };
  if (F.cols() == 0) fail("no triangles, expected a closed surface");
  if (F.minCoeff() < 0 || F.maxCoeff() >= X.cols())
    fail("vertex indices ", F.minCoeff(), " to ", F.maxCoeff(), ", expected 0 to ", X.cols() - 1);
  if (!X.allFinite()) fail("a coordinate is not finite");

  std::vector<bool> is_used(X.cols(), false);
  for (int v : F.reshaped()) is_used[v] = true;
  for (int v = 0; v < X.cols(); ++v)
    if (!is_used[v]) fail("vertex ", at(v), " belongs to no triangle");

  for (int f = 0; f < F.cols(); ++f) {
    const Eigen::Vector3d a = X.col(F(0, f)), b = X.col(F(1, f)), c = X.col(F(2, f));
    const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
    if (!((b - a).cross(c - a).norm() > degenerate_height * longest * longest))
      fail("triangle ", f, " has no area: vertices ", at(F(0, f)), ", ", at(F(1, f)), ", ", at(F(2, f)));
  }

  const std::vector<HalfEdge> edges = sorted_half_edges(F);
  for (size_t e = 0; e < edges.size();) {
    size_t end = e;
    while (end < edges.size() && edges[end].low == edges[e].low && edges[end].high == edges[e].high) ++end;
    if (end - e != 2)
      fail("edge ", at(edges[e].low), " to ", at(edges[e].high), " has ", end - e,
           " triangle(s), expected 2: the surface is ", end - e == 1 ? "open" : "not manifold");
    if (edges[e].is_forward == edges[e + 1].is_forward)
      fail("triangles ", edges[e].face, " and ", edges[e + 1].face,
           " are oriented against each other at edge ", at(edges[e].low), " to ", at(edges[e].high));
    e = end;
  }
  if (const int v = find_split_vertex(surface, edges); v >= 0)
    fail("vertex ", at(v), " joins separate fans of triangles: the surface is not manifold");
  if (const double V = volume(X, F); !(V > 0))
    fail("volume ", V, " m3, expected > 0: triangles must be oriented outward");
}

}  // namespace testbed
