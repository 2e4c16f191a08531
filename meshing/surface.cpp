#include "meshing/surface.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <vector>

namespace testbed {

double volume(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  double six_volumes = 0;
  for (int f = 0; f < F.cols(); ++f) {
    const Eigen::Vector3d a = X.col(F(0, f)) - centre, b = X.col(F(1, f)) - centre,
                          c = X.col(F(2, f)) - centre;
    six_volumes += a.dot(b.cross(c));
  }
  return six_volumes / 6;
}

Eigen::Matrix3Xd area_vectors(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  Eigen::Matrix3Xd A(3, F.cols());
  for (int f = 0; f < F.cols(); ++f) {
    const Eigen::Vector3d a = X.col(F(0, f));
    A.col(f) = (X.col(F(1, f)) - a).cross(X.col(F(2, f)) - a) / 2;
  }
  return A;
}

double area(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  return area_vectors(X, F).colwise().norm().sum();
}

Eigen::VectorXd vertex_areas(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  const Eigen::VectorXd triangle = area_vectors(X, F).colwise().norm();
  Eigen::VectorXd areas = Eigen::VectorXd::Zero(X.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) areas(F(c, f)) += triangle(f) / 3;
  return areas;
}

Eigen::Matrix2Xi edges_of(const Eigen::Matrix3Xi& F) {
  std::vector<std::pair<int, int>> edges;
  edges.reserve(3 * F.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) edges.push_back(std::minmax(F(c, f), F((c + 1) % 3, f)));
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Eigen::Matrix2Xi E(2, edges.size());
  for (size_t e = 0; e < edges.size(); ++e) E.col(e) << edges[e].first, edges[e].second;
  return E;
}

namespace {

struct HalfEdge {
  int from, to, triangle;
  bool operator<(const HalfEdge& o) const { return std::minmax(from, to) < std::minmax(o.from, o.to); }
};

}  // namespace

void check_closed(const SurfaceMesh& surface, const std::string& name) {
  const auto fail = [&](const std::string& what) { throw std::runtime_error(name + ": " + what); };
  const auto& [X, F] = surface;
  if (F.cols() == 0) fail("no triangles, expected a closed surface");
  if (!X.allFinite()) fail("a coordinate is not a finite number");

  const Eigen::VectorXd areas = area_vectors(X, F).colwise().norm();
  std::vector<HalfEdge> half_edges;
  std::vector<bool> is_used(X.cols());
  for (int f = 0; f < F.cols(); ++f) {
    if (!(areas(f) > 0)) fail("triangle " + std::to_string(f) + " has no area");
    for (int c = 0; c < 3; ++c) {
      half_edges.push_back({F(c, f), F((c + 1) % 3, f), f});
      is_used[F(c, f)] = true;
    }
  }
  const auto unused = std::find(is_used.begin(), is_used.end(), false);
  if (unused != is_used.end())
    fail("vertex " + std::to_string(unused - is_used.begin()) + " belongs to no triangle");

  std::sort(half_edges.begin(), half_edges.end());
  for (size_t i = 0; i < half_edges.size();) {
    size_t j = i + 1;
    while (j < half_edges.size() && !(half_edges[i] < half_edges[j])) ++j;
    const std::string edge =
        "edge " + std::to_string(half_edges[i].from) + "-" + std::to_string(half_edges[i].to);
    if (j - i != 2)
      fail(edge + " belongs to " + std::to_string(j - i) + " triangles, expected 2 (surface not closed)");
    if (half_edges[i].from == half_edges[i + 1].from)
      fail(edge + " is passed in the same direction by triangles " + std::to_string(half_edges[i].triangle) +
           " and " + std::to_string(half_edges[i + 1].triangle) + ", expected opposite orientations");
    i = j;
  }

  // The triangles around a vertex form one fan when, stepping across edges, one turn visits them all.
  std::vector<std::vector<std::pair<int, int>>> spokes(
      X.cols());  // next, previous vertex of each triangle there
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) spokes[F(c, f)].push_back({F((c + 1) % 3, f), F((c + 2) % 3, f)});
  for (int v = 0; v < X.cols(); ++v) {
    size_t turn = 0;
    int at = spokes[v].front().first;
    do {
      at = std::find_if(spokes[v].begin(), spokes[v].end(), [&](auto& s) { return s.first == at; })->second;
      ++turn;
    } while (at != spokes[v].front().first);
    if (turn != spokes[v].size())
      fail("vertex " + std::to_string(v) + " joins " + std::to_string(spokes[v].size()) +
           " triangles in more than one fan, expected one (not manifold)");
  }

  const double V = volume(X, F);
  if (!(V > 0)) {
    std::ostringstream what;
    what << "volume is " << V << " m3, expected > 0 (triangles counter-clockwise seen from outside)";
    fail(what.str());
  }
}

}  // namespace testbed
