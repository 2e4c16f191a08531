#include "meshing/surface/surface_faults.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <boost/pending/disjoint_sets.hpp>
#include <map>
#include <sstream>

#include "meshing/surface/shells.h"
#include "meshing/surface/surface.h"

namespace testbed::meshing {

namespace {

/// A triangle is degenerate when its height is below this
/// fraction of its longest edge: some thousand rounding errors.
constexpr double kDegenerateHeight = 1e-12;

struct HalfEdge {
  int low, high, face;
  bool is_forward;  // runs from low to high
};

/// Calls visit(first, last) for the half-edges of each edge, edges in ascending order.
template <class Visit>
void for_each_edge(const Eigen::Matrix3Xi& F, Visit visit) {
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
  for (size_t begin = 0, end; begin < edges.size(); begin = end) {
    for (end = begin;
         end < edges.size() && edges[end].low == edges[begin].low && edges[end].high == edges[begin].high;)
      ++end;
    visit(edges.data() + begin, edges.data() + end);
  }
}

bool is_degenerate(const Eigen::Matrix3Xd& X, const Eigen::Vector3i& f) {
  const Eigen::Vector3d a = X.col(f[0]), b = X.col(f[1]), c = X.col(f[2]);
  const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
  return !((b - a).cross(c - a).norm() > kDegenerateHeight * longest * longest);
}

/// Triangles with the same three vertices as an earlier one, each with that one.
std::vector<std::pair<int, int>> find_doubled(const Eigen::Matrix3Xi& F) {
  std::map<std::array<int, 3>, int> known;
  std::vector<std::pair<int, int>> doubled;
  for (int f = 0; f < F.cols(); ++f) {
    std::array<int, 3> key{F(0, f), F(1, f), F(2, f)};
    std::sort(key.begin(), key.end());
    const auto [entry, is_new] = known.try_emplace(key, f);
    if (!is_new) doubled.emplace_back(f, entry->second);
  }
  return doubled;
}

/// Vertices whose triangles form more than one fan. Every edge must have two triangles.
std::vector<int> find_split_vertices(const SurfaceMesh& surface) {
  // Corners of one vertex are joined across the edges that they share: as many groups as fans.
  const auto& F = surface.F;
  boost::disjoint_sets_with_storage<> fans(3 * F.cols());
  auto corner = [&](int face, int vertex) {
    int c = 0;
    while (F(c, face) != vertex) ++c;
    return 3 * face + c;
  };
  for_each_edge(F, [&](const HalfEdge* e, const HalfEdge*) {
    for (int vertex : {e->low, e->high}) fans.union_set(corner(e[0].face, vertex), corner(e[1].face, vertex));
  });
  std::vector<int> fan_of(surface.X.cols(), -1), split;
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) {
      const int fan = static_cast<int>(fans.find_set(3 * f + c));
      int& known = fan_of[F(c, f)];
      if (known >= 0 && known != fan) split.push_back(F(c, f));
      known = fan;
    }
  std::sort(split.begin(), split.end());
  split.erase(std::unique(split.begin(), split.end()), split.end());
  return split;
}

std::vector<Shell> misturned_shells(const SurfaceMesh& surface) {
  std::vector<Shell> shells = shells_of(surface);
  shells.erase(std::remove_if(shells.begin(), shells.end(),
                              [](const Shell& s) { return s.depth % 2 == 0 ? s.volume > 0 : s.volume < 0; }),
               shells.end());
  return shells;
}

/// Turns triangles against their neighbours until each connected part agrees with its first; parts that
/// cannot agree (a Moebius strip) are left half turned. Returns which were turned.
std::vector<bool> make_consistent(SurfaceMesh& surface) {
  auto& F = surface.F;
  std::vector<std::vector<std::pair<int, bool>>> neighbours(F.cols());  // triangle, whether it agrees
  for_each_edge(F, [&](const HalfEdge* e, const HalfEdge* end) {
    if (end - e != 2) return;
    const bool agrees = e[0].is_forward != e[1].is_forward;
    neighbours[e[0].face].emplace_back(e[1].face, agrees);
    neighbours[e[1].face].emplace_back(e[0].face, agrees);
  });
  std::vector<bool> is_seen(F.cols(), false), is_turned(F.cols(), false);
  for (int seed = 0; seed < F.cols(); ++seed) {
    if (is_seen[seed]) continue;
    std::vector<int> stack{seed};
    is_seen[seed] = true;
    while (!stack.empty()) {
      const int f = stack.back();
      stack.pop_back();
      for (const auto& [g, agrees] : neighbours[f])
        if (!is_seen[g]) {
          is_seen[g] = true;
          is_turned[g] = is_turned[f] == agrees;
          stack.push_back(g);
        }
    }
  }
  for (int f = 0; f < F.cols(); ++f)
    if (is_turned[f]) std::swap(F(0, f), F(1, f));
  return is_turned;
}

}  // namespace

bool SurfaceFaults::none() const {
  return unused_vertices.empty() && degenerate_triangles.empty() && doubled_triangles.empty() &&
         is_closed() && is_manifold() && disoriented_edges.empty() && misturned_triangles.empty();
}

SurfaceFaults find_faults(const SurfaceMesh& surface) {
  const Eigen::Matrix3Xd& X = surface.X;
  const Eigen::Matrix3Xi& F = surface.F;
  SurfaceFaults faults;
  std::vector<bool> is_used(X.cols(), false);
  for (int v : F.reshaped()) is_used[v] = true;
  for (int v = 0; v < X.cols(); ++v)
    if (!is_used[v]) faults.unused_vertices.push_back(v);
  for (int f = 0; f < F.cols(); ++f)
    if (is_degenerate(X, F.col(f))) faults.degenerate_triangles.push_back(f);
  for (const auto& [f, earlier] : find_doubled(F)) faults.doubled_triangles.push_back(f);
  for_each_edge(F, [&](const HalfEdge* e, const HalfEdge* end) {
    const std::pair edge(e->low, e->high);
    if (end - e == 1) faults.open_edges.push_back(edge);
    if (end - e > 2) faults.crowded_edges.push_back(edge);
    if (end - e == 2 && e[0].is_forward == e[1].is_forward) faults.disoriented_edges.push_back(edge);
  });
  if (faults.open_edges.empty() && faults.crowded_edges.empty()) {
    faults.split_vertices = find_split_vertices(surface);
    if (faults.split_vertices.empty() && faults.disoriented_edges.empty())
      for (const Shell& shell : misturned_shells(surface))
        faults.misturned_triangles.push_back(shell.triangles[0]);
  }
  return faults;
}

std::string vertex_text(const SurfaceMesh& surface, int vertex) {
  std::ostringstream text;
  const auto x = surface.X.col(vertex);
  text << vertex << " (" << x[0] << ", " << x[1] << ", " << x[2] << ")";
  return text.str();
}

std::vector<std::string> describe(const SurfaceFaults& faults, const SurfaceMesh& surface) {
  std::vector<std::string> lines;
  auto vertex = [&](int v) { return "vertex " + vertex_text(surface, v); };
  auto edge = [&](const std::pair<int, int>& e) {
    return "edge " + vertex_text(surface, e.first) + " to " + vertex_text(surface, e.second);
  };
  auto triangle = [&](int f) {
    return "triangle " + std::to_string(f) + " at vertex " + vertex_text(surface, surface.F(0, f));
  };
  auto add = [&](const auto& list, const std::string& what, auto place) {
    if (!list.empty())
      lines.push_back(std::to_string(list.size()) + " " + what + ", first " + place(list.front()));
  };
  add(faults.unused_vertices, "vertices belong to no triangle", vertex);
  add(faults.degenerate_triangles, "triangles have no area", triangle);
  add(faults.doubled_triangles, "triangles have the vertices of another", triangle);
  add(faults.open_edges, "edges have one triangle: the surface is open", edge);
  add(faults.crowded_edges, "edges have more than two triangles: the surface is not manifold", edge);
  add(faults.split_vertices, "vertices join separate fans of triangles: the surface is not manifold", vertex);
  add(faults.disoriented_edges, "edges lie between triangles oriented against each other", edge);
  add(faults.misturned_triangles, "connected parts are not oriented outward (a cavity: inward)", triangle);
  return lines;
}

SurfaceMesh repair(const SurfaceMesh& surface, RepairReport& report) {
  report = {};
  std::vector<bool> is_dropped(surface.F.cols(), false);
  auto drop = [&](int f, int& count) {
    count += !is_dropped[f];
    is_dropped[f] = true;
  };
  for (int f = 0; f < surface.F.cols(); ++f) {
    const auto corners = surface.F.col(f);
    if (corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0])
      drop(f, report.n_degenerate_triangles);
  }
  auto is_turned_alike = [&](int f, int g) {
    int c = 0;
    while (surface.F(c, g) != surface.F(0, f)) ++c;
    return surface.F((c + 1) % 3, g) == surface.F(1, f);
  };
  for (const auto& [f, earlier] : find_doubled(surface.F)) {
    if (is_dropped[f]) continue;
    if (!is_dropped[earlier] && !is_turned_alike(f, earlier)) drop(earlier, report.n_doubled_triangles);
    drop(f, report.n_doubled_triangles);
  }

  std::vector<int> kept, new_index(surface.X.cols(), -1), vertices;
  for (int f = 0; f < surface.F.cols(); ++f)
    if (!is_dropped[f]) kept.push_back(f);
  SurfaceMesh mended{{}, surface.F(Eigen::all, kept)};
  for (int v : mended.F.reshaped()) new_index[v] = 0;
  for (int v = 0; v < surface.X.cols(); ++v)
    if (new_index[v] == 0) {
      new_index[v] = static_cast<int>(vertices.size());
      vertices.push_back(v);
    }
  report.n_unused_vertices = static_cast<int>(surface.X.cols() - vertices.size());
  mended.X = surface.X(Eigen::all, vertices);
  for (int& v : mended.F.reshaped()) v = new_index[v];

  std::vector<bool> is_turned = make_consistent(mended);
  const SurfaceFaults left = find_faults(mended);
  if (left.is_closed() && left.is_manifold() && left.disoriented_edges.empty())
    for (const Shell& shell : misturned_shells(mended))
      for (int f : shell.triangles) {
        std::swap(mended.F(0, f), mended.F(1, f));
        is_turned[f] = !is_turned[f];
      }
  report.n_turned_triangles = static_cast<int>(std::count(is_turned.begin(), is_turned.end(), true));
  return mended;
}

}  // namespace testbed::meshing
