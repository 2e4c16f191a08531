#include "meshing/surface/shapes.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <stdexcept>

namespace testbed::meshing {

namespace {

constexpr double kPi = 3.14159265358979323846;

SurfaceMesh to_mesh(const std::vector<Eigen::Vector3d>& points,
                    const std::vector<Eigen::Vector3i>& triangles) {
  SurfaceMesh mesh{Eigen::Matrix3Xd(3, points.size()), Eigen::Matrix3Xi(3, triangles.size())};
  for (size_t i = 0; i < points.size(); ++i) mesh.X.col(i) = points[i];
  for (size_t f = 0; f < triangles.size(); ++f) mesh.F.col(f) = triangles[f];
  return mesh;
}

/// Geodesic sphere of radius 1: every side of the icosahedron
/// in `frequency` parts, 10 frequency^2 + 2 vertices.
SurfaceMesh make_ball(int n_vertices) {
  const int frequency = std::max(1, static_cast<int>(std::lround(std::sqrt((n_vertices - 2) / 10.0))));
  const double g = (1 + std::sqrt(5.0)) / 2;
  const std::vector<Eigen::Vector3d> corners = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                                                {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                                                {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
  const int sides[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                            {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                            {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                            {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;
  std::map<std::map<int, int>, int>
      known;  // weight of each corner -> vertex: shared along the sides' common edges
  for (const auto& side : sides) {
    auto vertex = [&](int i, int j) {
      const int weights[3] = {frequency - i - j, i, j};
      std::map<int, int> key;
      Eigen::Vector3d p = Eigen::Vector3d::Zero();
      for (int c = 0; c < 3; ++c)
        if (weights[c] > 0) {
          key[side[c]] = weights[c];
          p += weights[c] * corners[side[c]];
        }
      const auto [entry, is_new] = known.try_emplace(key, static_cast<int>(points.size()));
      if (is_new) points.push_back(p.normalized());
      return entry->second;
    };
    for (int i = 0; i < frequency; ++i)
      for (int j = 0; i + j < frequency; ++j) {
        triangles.emplace_back(vertex(i, j), vertex(i + 1, j), vertex(i, j + 1));
        if (i + j + 1 < frequency)
          triangles.emplace_back(vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1));
      }
  }
  return to_mesh(points, triangles);
}

/// Factors (n_u, n_v), both at least 3, whose product is nearest to n while n_u/n_v stays within a factor 2
/// of `ratio`; of equally near ones those nearest to the ratio.
std::pair<int, int> factor_grid(int n, double ratio) {
  std::pair<int, int> best{3, 3};
  auto misfit = [&](std::pair<int, int> g) {
    return std::pair(std::abs(g.first * g.second - n), std::abs(std::log(g.first / (ratio * g.second))));
  };
  auto consider = [&](int u, int v) {
    if (u >= 3 && misfit({u, v}).second <= std::log(2.0) && misfit({u, v}) < misfit(best)) best = {u, v};
  };
  for (int v = 3; v * v * ratio <= 2.5 * n + 9; ++v) {
    consider(n / v, v);
    consider(n / v + 1, v);
  }
  return best;
}

/// Torus of radii 1 and 0.4 about the z axis.
SurfaceMesh make_torus(int n_vertices) {
  const double major = 1, minor = 0.4;
  const auto [n_u, n_v] = factor_grid(n_vertices, major / minor);
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;
  for (int i = 0; i < n_u; ++i)
    for (int j = 0; j < n_v; ++j) {
      const double u = 2 * kPi * i / n_u, v = 2 * kPi * j / n_v, r = major + minor * std::cos(v);
      points.emplace_back(r * std::cos(u), r * std::sin(u), minor * std::sin(v));
      const int a = i * n_v + j, b = (i + 1) % n_u * n_v + j;
      const int d = i * n_v + (j + 1) % n_v, c = (i + 1) % n_u * n_v + (j + 1) % n_v;
      if ((i + j) % 2 == 0) {
        triangles.emplace_back(a, b, c);
        triangles.emplace_back(a, c, d);
      } else {
        triangles.emplace_back(a, b, d);
        triangles.emplace_back(b, c, d);
      }
    }
  return to_mesh(points, triangles);
}

/// Box of cells as cubic as the size allows, a corner at the origin;
/// diagonals join the even points of the lattice.
SurfaceMesh make_bar(int n_vertices, const Eigen::Vector3d& size) {
  auto count = [](const Eigen::Vector3i& n) { return 2 * (n[0] * n[1] + n[1] * n[2] + n[2] * n[0]) + 2; };
  Eigen::Vector3i cells(1, 1, 1);
  Eigen::Vector3i next = cells;
  for (double h = size.maxCoeff(); count(next) < 2 * n_vertices; h *= 0.99) {
    next = (size / h).array().round().cast<int>().max(1);
    if (std::abs(count(next) - n_vertices) < std::abs(count(cells) - n_vertices)) cells = next;
  }
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;
  std::map<std::array<int, 3>, int> known;
  auto vertex = [&](const Eigen::Vector3i& p) {
    const auto [entry, is_new] = known.try_emplace({p[0], p[1], p[2]}, static_cast<int>(points.size()));
    if (is_new) points.push_back(p.cast<double>().cwiseProduct(size).cwiseQuotient(cells.cast<double>()));
    return entry->second;
  };
  for (int axis = 0; axis < 3; ++axis)
    for (int side : {0, 1}) {
      const int u = (axis + (side ? 1 : 2)) % 3, v = (axis + (side ? 2 : 1)) % 3;  // u x v points outward
      for (int i = 0; i < cells[u]; ++i)
        for (int j = 0; j < cells[v]; ++j) {
          Eigen::Vector3i p;
          p[axis] = side * cells[axis];
          p[u] = i;
          p[v] = j;
          const Eigen::Vector3i e_u = Eigen::Vector3i::Unit(u), e_v = Eigen::Vector3i::Unit(v);
          const int a = vertex(p), b = vertex(p + e_u), c = vertex(p + e_u + e_v), d = vertex(p + e_v);
          if (p.sum() % 2 == 0) {
            triangles.emplace_back(a, b, c);
            triangles.emplace_back(a, c, d);
          } else {
            triangles.emplace_back(a, b, d);
            triangles.emplace_back(b, c, d);
          }
        }
    }
  return to_mesh(points, triangles);
}

/// Closed surface of rings between two poles (vertices 0 and last);
/// ring k holds sizes[k] points, from `point(k, angle)` with the angle turning
/// counter-clockwise seen from the last pole. Neighbouring rings are zipped by angle.
SurfaceMesh zip_rings(const std::vector<int>& sizes, const std::function<Eigen::Vector3d(int, double)>& point,
                      const Eigen::Vector3d& first_pole, const Eigen::Vector3d& last_pole) {
  std::vector<Eigen::Vector3d> points{first_pole};
  std::vector<Eigen::Vector3i> triangles;
  std::vector<int> starts;
  const int n_rings = static_cast<int>(sizes.size());
  auto turn = [&](int k, int j) {
    return (j + (k % 2 ? 0.5 : 0.0)) / sizes[k];
  };  // rings staggered by half a step
  for (int k = 0; k < n_rings; ++k) {
    starts.push_back(static_cast<int>(points.size()));
    for (int j = 0; j < sizes[k]; ++j) points.push_back(point(k, 2 * kPi * turn(k, j)));
  }
  const int last = static_cast<int>(points.size());
  points.push_back(last_pole);
  auto vertex = [&](int k, int j) { return starts[k] + j % sizes[k]; };
  for (int j = 0; j < sizes[0]; ++j) triangles.emplace_back(0, vertex(0, j + 1), vertex(0, j));
  for (int k = 0; k + 1 < n_rings; ++k)
    for (int i = 0, j = 0; i < sizes[k] || j < sizes[k + 1];) {
      // advance on the ring whose next point comes first: the shorter diagonal
      const bool is_lower = j == sizes[k + 1] || (i < sizes[k] && turn(k, i + 1) <= turn(k + 1, j + 1));
      const int a = vertex(k, i), b = vertex(k + 1, j);
      triangles.emplace_back(a, is_lower ? vertex(k, i + 1) : vertex(k + 1, j + 1), b);
      ++(is_lower ? i : j);
    }
  for (int j = 0; j < sizes.back(); ++j)
    triangles.emplace_back(vertex(n_rings - 1, j), vertex(n_rings - 1, j + 1), last);
  return to_mesh(points, triangles);
}

/// A long round tube of radius 0.1, bent to a half circle with two straight legs and closed by half spheres.
SurfaceMesh make_handle(int n_vertices) {
  const double r = 0.1, bend = 0.5, leg = 0.4;  // radii of tube and bend, length of a leg (m)
  const double cap = kPi * r / 2, axis = 2 * leg + kPi * bend, whole = axis + 2 * cap;
  const auto [n_rings, n_around] = factor_grid(n_vertices - 2, whole / (2 * kPi * r));
  // Centre line up the left leg, over the bend, down the right leg; frame (side, tangent) in the xz plane.
  auto place = [&](double s, double radius, double angle) {
    Eigen::Vector3d centre, side;
    const double a = std::clamp((s - leg) / bend, 0.0, kPi),
                 straight = s < leg ? s - leg : std::max(0.0, s - leg - kPi * bend);
    side << -std::cos(a), 0, std::sin(a);
    const Eigen::Vector3d tangent(std::sin(a), 0, std::cos(a));
    centre = bend * side + straight * tangent;
    return Eigen::Vector3d(centre +
                           radius * (std::cos(angle) * side - std::sin(angle) * Eigen::Vector3d::UnitY()));
  };
  auto point = [&, n_rings = n_rings](int k, double angle) {
    const double s = whole * (k + 1) / (n_rings + 1);  // along the outline, pole to pole
    if (s < cap) return place(-r * std::cos(s / r), r * std::sin(s / r), angle);
    if (s > whole - cap)
      return place(axis + r * std::cos((whole - s) / r), r * std::sin((whole - s) / r), angle);
    return place(s - cap, r, angle);
  };
  return zip_rings(std::vector<int>(n_rings, n_around), point, place(-r, 0, 0), place(axis + r, 0, 0));
}

/// Sizes of rings that cover a sphere evenly with n vertices, poles included.
std::vector<int> even_rings(int n) {
  // Rings are as far apart as the points of a ring:
  // (pi/n_rings)^2 = area per point = 4 pi/n, a little less for triangles.
  const int n_rings = std::max(1, static_cast<int>(std::lround(std::sqrt(n * kPi / 4 * 1.1547))) - 1);
  double total = 0;
  for (int k = 0; k < n_rings; ++k) total += std::sin(kPi * (k + 1) / (n_rings + 1));
  std::vector<int> sizes(n_rings);
  double wanted = 0;
  int given = 0;
  for (int k = 0; k < n_rings; ++k) {
    wanted += (n - 2) * std::sin(kPi * (k + 1) / (n_rings + 1)) / total;
    sizes[k] = std::max(3, static_cast<int>(std::lround(wanted)) - given);
    given += sizes[k];
  }
  sizes[n_rings / 2] += n - 2 - given;
  return sizes;
}

/// A head on its neck, about 2 m high, looking along x:
/// a level set of a sum of Gaussians, star-shaped about the origin.
SurfaceMesh make_head(int n_vertices) {
  struct Blob {
    Eigen::Vector3d centre, radii;
    double weight;
  };
  const std::vector<Blob> blobs = {{{-0.05, 0, 0.15}, {0.85, 0.70, 0.85}, 1.0},   // skull
                                   {{0.30, 0, -0.45}, {0.50, 0.45, 0.45}, 0.6},   // jaw
                                   {{0.78, 0, -0.08}, {0.16, 0.13, 0.22}, 0.35},  // nose
                                   {{-0.05, 0.68, -0.05}, {0.18, 0.10, 0.25}, 0.3},
                                   {{-0.05, -0.68, -0.05}, {0.18, 0.10, 0.25}, 0.3},  // ears
                                   {{-0.10, 0, -0.95}, {0.40, 0.42, 0.50}, 0.8}};     // neck
  auto level = [&](const Eigen::Vector3d& x) {
    double sum = -0.35;
    for (const auto& b : blobs)
      sum += b.weight * std::exp(-(x - b.centre).cwiseQuotient(b.radii).squaredNorm());
    return sum;
  };
  auto project = [&](const Eigen::Vector3d& direction) {
    double inside = 0, outside = 3;
    for (int halving = 0; halving < 55; ++halving) {  // to rounding
      const double middle = (inside + outside) / 2;
      (level(middle * direction) > 0 ? inside : outside) = middle;
    }
    return Eigen::Vector3d(inside * direction);
  };
  const std::vector<int> sizes = even_rings(n_vertices);
  const int n_rings = static_cast<int>(sizes.size());
  auto point = [&](int k, double angle) {
    const double polar = kPi * (k + 1) / (n_rings + 1);  // from the lower pole
    return project({std::sin(polar) * std::cos(angle), std::sin(polar) * std::sin(angle), -std::cos(polar)});
  };
  return zip_rings(sizes, point, project({0, 0, -1}), project({0, 0, 1}));
}

/// A ball around a cavity of half its radius, each with half of the vertices.
SurfaceMesh make_hollow_ball(int n_vertices) {
  SurfaceMesh mesh = make_ball(n_vertices / 2);
  const Eigen::Matrix3Xd X = mesh.X;
  const Eigen::Matrix3Xi F = mesh.F.array() + static_cast<int>(X.cols());
  mesh.X.conservativeResize(3, 2 * X.cols());
  mesh.X.rightCols(X.cols()) = X / 2;
  mesh.F.conservativeResize(3, 2 * F.cols());
  mesh.F.rightCols(F.cols()) = F.colwise().reverse();  // out of the solid
  return mesh;
}

}  // namespace

const std::vector<std::string>& shape_names() {
  static const std::vector<std::string> kNames = {"ball", "hollow_ball", "torus", "bar", "handle", "head"};
  return kNames;
}

SurfaceMesh make_shape(const std::string& name, int n_vertices, const Eigen::Vector3d& size) {
  const std::map<std::string, int> fewest = {{"ball", 12}, {"hollow_ball", 24}, {"torus", 36},
                                             {"bar", 8},   {"handle", 80},      {"head", 20}};
  const auto entry = fewest.find(name);
  if (entry == fewest.end())
    throw std::runtime_error("shape '" + name + "', expected ball, hollow_ball, torus, bar, handle or head");
  if (n_vertices < entry->second)
    throw std::runtime_error("shape " + name + " with " + std::to_string(n_vertices) +
                             " vertices, expected at least " + std::to_string(entry->second));
  constexpr int kMost = 1000000;  // more than what fills them is solved for
  if (n_vertices > kMost)
    throw std::runtime_error("shape " + name + " with " + std::to_string(n_vertices) +
                             " vertices, expected at most " + std::to_string(kMost));
  const Eigen::Vector3d bar_size = (size.array() > 0).select(size, Eigen::Vector3d(4, 1, 1));
  SurfaceMesh mesh = name == "ball"          ? make_ball(n_vertices)
                     : name == "hollow_ball" ? make_hollow_ball(n_vertices)
                     : name == "torus"       ? make_torus(n_vertices)
                     : name == "bar"         ? make_bar(n_vertices, bar_size)
                     : name == "handle"      ? make_handle(n_vertices)
                                             : make_head(n_vertices);
  const Eigen::Vector3d own = mesh.X.rowwise().maxCoeff() - mesh.X.rowwise().minCoeff();
  mesh.X.array().colwise() *= (size.array() > 0).select(size.array() / own.array(), 1);
  return mesh;
}

}  // namespace testbed::meshing
