#include "meshing/shapes.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <vector>

namespace testbed {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// Icosahedron with every edge cut into f parts, on the unit sphere: 10 f^2 + 2 vertices.
SurfaceMesh geodesic_sphere(int f) {
  const double g = (1 + std::sqrt(5.0)) / 2;
  const Eigen::Matrix<double, 12, 3> corners =
      (Eigen::Matrix<double, 12, 3>() << -1, g, 0, 1, g, 0, -1, -g, 0, 1, -g, 0, 0, -1, g, 0, 1, g, 0, -1, -g,
       0, 1, -g, g, 0, -1, g, 0, 1, -g, 0, -1, -g, 0, 1)
          .finished();
  const int faces[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                            {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                            {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                            {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;
  // A point is known by its whole-number weights at the icosahedron's corners, so shared edges give the same
  // point.
  std::map<std::vector<std::pair<int, int>>, int> index_of;
  for (const auto& face : faces) {
    const auto point = [&](int i, int j) {
      const int weights[3] = {f - i - j, i, j};
      std::vector<std::pair<int, int>> key;
      Eigen::Vector3d p = Eigen::Vector3d::Zero();
      for (int c = 0; c < 3; ++c)
        if (weights[c] > 0) key.emplace_back(face[c], weights[c]);
      std::sort(key.begin(), key.end());
      for (const auto& [corner, weight] : key) p += weight * corners.row(corner).transpose();
      const auto [at, is_new] = index_of.try_emplace(key, points.size());
      if (is_new) points.push_back(p.normalized());
      return at->second;
    };
    for (int i = 0; i < f; ++i)
      for (int j = 0; i + j < f; ++j) {
        triangles.emplace_back(point(i, j), point(i + 1, j), point(i, j + 1));
        if (i + j < f - 1) triangles.emplace_back(point(i + 1, j), point(i + 1, j + 1), point(i, j + 1));
      }
  }
  SurfaceMesh mesh{Eigen::Matrix3Xd(3, points.size()), Eigen::Matrix3Xi(3, triangles.size())};
  for (size_t i = 0; i < points.size(); ++i) mesh.X.col(i) = points[i];
  for (size_t t = 0; t < triangles.size(); ++t) mesh.F.col(t) = triangles[t];
  return mesh;
}

/// Rings of `n_around` vertices joined into a tube; ring r + 1 is turned by half a step against ring r where
/// `is_staggered`. The tube closes on itself (torus) or ends in a vertex at either end, whose indices are the
/// last two.
SurfaceMesh tube_of_rings(const Eigen::Matrix3Xd& X, int n_rings, int n_around, bool is_closed) {
  std::vector<Eigen::Vector3i> triangles;
  const auto at = [&](int ring, int k) { return (ring % n_rings) * n_around + (k % n_around); };
  for (int r = 0; r < (is_closed ? n_rings : n_rings - 1); ++r)
    for (int k = 0; k < n_around; ++k) {
      triangles.emplace_back(at(r, k), at(r, k + 1), at(r + 1, k));
      triangles.emplace_back(at(r, k + 1), at(r + 1, k + 1), at(r + 1, k));
    }
  if (!is_closed)
    for (int k = 0; k < n_around; ++k) {
      triangles.emplace_back(at(0, k + 1), at(0, k), n_rings * n_around);
      triangles.emplace_back(at(n_rings - 1, k), at(n_rings - 1, k + 1), n_rings * n_around + 1);
    }
  SurfaceMesh mesh{X, Eigen::Matrix3Xi(3, triangles.size())};
  for (size_t t = 0; t < triangles.size(); ++t) mesh.F.col(t) = triangles[t];
  return mesh;
}

/// Numbers (a, b) with a * b nearest to n, a / b nearest to the ratio; a >= a_min a multiple of a_step, b >=
/// b_min.
std::pair<int, int> factor_near(int n, double ratio, int a_min, int b_min, int a_step = 1) {
  std::pair<int, int> best{a_min, b_min};
  double best_cost = INFINITY;
  for (int b = b_min; b * a_min <= n + b_min; ++b) {
    const int a =
        std::max(a_min, a_step * static_cast<int>(std::lround(static_cast<double>(n) / b / a_step)));
    const double cost = 200 * std::abs(std::log(static_cast<double>(a) * b / n)) +
                        std::abs(std::log(static_cast<double>(a) / b / ratio));
    if (cost < best_cost) best = {a, b}, best_cost = cost;
  }
  return best;
}

constexpr double kTorusMajor = 1, kTorusMinor = 0.35;

SurfaceMesh make_torus(int n) {
  const auto [n_rings, n_around] = factor_near(n, kTorusMajor / kTorusMinor, 4, 3, 2);
  Eigen::Matrix3Xd X(3, n_rings * n_around);
  for (int r = 0; r < n_rings; ++r)
    for (int k = 0; k < n_around; ++k) {
      const double u = 2 * kPi * r / n_rings, v = 2 * kPi * (k + 0.5 * r) / n_around;
      const double rho = kTorusMajor + kTorusMinor * std::cos(v);
      X.col(r * n_around + k) << rho * std::cos(u), rho * std::sin(u), -kTorusMinor * std::sin(v);
    }
  // Half a step a ring adds up to n_rings / 2 steps where the tube closes: the seam is joined with that
  // shift.
  SurfaceMesh mesh = tube_of_rings(X, n_rings, n_around, true);
  const auto shifted = [&](int vertex) { return (vertex + n_rings / 2) % n_around; };
  const int last_ring = (n_rings - 1) * n_around;
  for (int f = 0; f < mesh.F.cols(); ++f)
    if (mesh.F.col(f).maxCoeff() >= last_ring && mesh.F.col(f).minCoeff() < n_around)
      for (int c = 0; c < 3; ++c)
        if (mesh.F(c, f) < n_around) mesh.F(c, f) = shifted(mesh.F(c, f));
  return mesh;
}

/// A tube of round section about the line centre(s), s in [0, 1], with rounded ends; frame from the curve's
/// plane (x, z).
SurfaceMesh make_handle(int n) {
  constexpr double kBendRadius = 1, kLeg = 1, kRadius = 0.25;
  const double arc = kPi * kBendRadius, length = arc + 2 * kLeg;
  const auto [n_rings, n_around] = factor_near(n - 2, (length + 2 * kRadius) / (2 * kPi * kRadius), 5, 4);
  Eigen::Matrix3Xd X(3, n_rings * n_around + 2);
  // Distance along the outline in the plane of the axis: cap, wall, cap.
  const double cap = kPi / 2 * kRadius, outline = length + 2 * cap;
  const auto place = [&](double s, double radius, double angle) {
    Eigen::Vector3d centre, out;  // out: away from the centre of the bend, in the plane
    if (s < kLeg || s > kLeg + arc) {
      const double side = s < kLeg ? 1 : -1, down = s < kLeg ? kLeg - s : s - kLeg - arc;
      centre << side * kBendRadius, 0, -down;
      out << side, 0, 0;
    } else {
      const double turn = (s - kLeg) / kBendRadius;
      out << std::cos(turn), 0, std::sin(turn);
      centre = kBendRadius * out;
    }
    return Eigen::Vector3d(centre +
                           radius * (std::cos(angle) * out + std::sin(angle) * Eigen::Vector3d::UnitY()));
  };
  for (int r = 0; r < n_rings; ++r) {
    const double along = outline * (r + 1) / (n_rings + 1);
    double s = along - cap, radius = kRadius;
    if (along < cap) s = -kRadius * std::cos(along / kRadius), radius = kRadius * std::sin(along / kRadius);
    if (along > outline - cap) {
      const double back = (outline - along) / kRadius;
      s = length + kRadius * std::cos(back), radius = kRadius * std::sin(back);
    }
    for (int k = 0; k < n_around; ++k)
      X.col(r * n_around + k) = place(s, radius, 2 * kPi * (k + 0.5 * r) / n_around);
  }
  X.col(n_rings * n_around) = place(-kRadius, 0, 0);
  X.col(n_rings * n_around + 1) = place(length + kRadius, 0, 0);
  return tube_of_rings(X, n_rings, n_around, false);
}

/// Points spread evenly over the unit sphere along a spiral [Swinbank & Purser 2006], n of any number, joined
/// by their convex hull.
SurfaceMesh spiral_sphere(int n);

/// A ball with a face: radius 1 plus smooth bumps for nose, chin and skull; star-shaped about the origin.
double head_radius(const Eigen::Vector3d& d) {
  const auto bump = [&](double x, double y, double z, double height, double width) {
    const double angle = std::acos(std::clamp(d.dot(Eigen::Vector3d(x, y, z).normalized()), -1.0, 1.0));
    return height * std::exp(-angle * angle / (2 * width * width));
  };
  return 1 + bump(1, 0, 0.05, 0.28, 0.16)                                    // nose
         + bump(0.75, 0, -0.8, 0.22, 0.35)                                   // chin
         + bump(-0.7, 0, 0.5, 0.18, 0.6)                                     // back of the skull
         - bump(1, 0.38, 0.28, 0.1, 0.16) - bump(1, -0.38, 0.28, 0.1, 0.16)  // eyes
         + bump(0, 1, 0.05, 0.14, 0.17) + bump(0, -1, 0.05, 0.14, 0.17)      // ears
         - bump(-0.5, 0, -1, 0.12, 0.4);                                     // neck
}

SurfaceMesh make_head(int n) {
  SurfaceMesh mesh = spiral_sphere(n);
  for (int i = 0; i < mesh.X.cols(); ++i) {
    const Eigen::Vector3d d = mesh.X.col(i);
    mesh.X.col(i) = head_radius(d) * d.cwiseProduct(Eigen::Vector3d(0.95, 0.8, 1.15));
  }
  return mesh;
}

/// Box of n_x x n_y x n_z cells, two triangles a cell side.
SurfaceMesh make_bar(int n, const Eigen::Vector3d& size) {
  const double spacing =
      std::sqrt(2 * (size.x() * size.y() + size.y() * size.z() + size.z() * size.x()) / std::max(n - 2, 1));
  Eigen::Vector3i best = Eigen::Vector3i::Ones();
  const auto count = [](const Eigen::Vector3i& c) {
    return 2 * (c.x() * c.y() + c.y() * c.z() + c.z() * c.x()) + 2;
  };
  double best_cost = INFINITY;
  for (double s = spacing / 2; s < 2 * spacing; s *= 1.005) {
    const Eigen::Vector3i cells = (size / s).array().round().max(1).matrix().cast<int>();
    if (const double cost = std::abs(count(cells) - n); cost < best_cost) best = cells, best_cost = cost;
  }

  std::map<std::array<int, 3>, int> index_of;
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3i> triangles;
  const auto vertex = [&](const std::array<int, 3>& grid) {
    const auto [at, is_new] = index_of.try_emplace(grid, points.size());
    if (is_new)
      points.emplace_back(size.x() * grid[0] / best[0], size.y() * grid[1] / best[1],
                          size.z() * grid[2] / best[2]);
    return at->second;
  };
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      for (int i = 0; i < best[u]; ++i)
        for (int j = 0; j < best[v]; ++j) {
          std::array<int, 3> g{};
          g[axis] = side * best[axis];
          const auto corner = [&](int a, int b) {
            g[u] = i + a, g[v] = j + b;
            return vertex(g);
          };
          int a = corner(0, 0), b = corner(1, 0), c = corner(1, 1), d = corner(0, 1);
          if (side == 0) std::swap(b, d);
          // Alternating diagonals, so that the surface has no preferred direction.
          if ((i + j) % 2 == 0) {
            triangles.emplace_back(a, b, c);
            triangles.emplace_back(a, c, d);
          } else {
            triangles.emplace_back(a, b, d);
            triangles.emplace_back(b, c, d);
          }
        }
    }
  SurfaceMesh mesh{Eigen::Matrix3Xd(3, points.size()), Eigen::Matrix3Xi(3, triangles.size())};
  for (size_t i = 0; i < points.size(); ++i) mesh.X.col(i) = points[i];
  for (size_t t = 0; t < triangles.size(); ++t) mesh.F.col(t) = triangles[t];
  return mesh;
}

/// Convex hull of points on a sphere, no four on a circle, by adding one point after another.
Eigen::Matrix3Xi convex_hull(const Eigen::Matrix3Xd& X) {
  struct Face {
    int v[3];
    bool is_alive;
  };
  std::vector<Face> faces;
  std::map<std::pair<int, int>, int> face_of_edge;  // directed edge -> the face on its left
  const auto add = [&](int a, int b, int c) {
    for (auto [p, q] : {std::pair{a, b}, {b, c}, {c, a}})
      face_of_edge[{p, q}] = static_cast<int>(faces.size());
    faces.push_back({{a, b, c}, true});
  };
  const auto sees = [&](int f, int p) {
    const Eigen::Vector3d a = X.col(faces[f].v[0]);
    return (X.col(faces[f].v[1]) - a).cross(X.col(faces[f].v[2]) - a).dot(X.col(p) - a) > 0;
  };
  if ((X.col(1) - X.col(0)).cross(X.col(2) - X.col(0)).dot(X.col(3) - X.col(0)) < 0) {
    add(0, 1, 2), add(0, 3, 1), add(1, 3, 2), add(2, 3, 0);
  } else {
    add(0, 2, 1), add(0, 1, 3), add(1, 2, 3), add(2, 0, 3);
  }
  for (int p = 4; p < X.cols(); ++p) {
    // Neighbouring points follow one another along the spiral, so the newest faces are searched first.
    int seed = static_cast<int>(faces.size()) - 1;
    while (seed >= 0 && !(faces[seed].is_alive && sees(seed, p))) --seed;
    if (seed < 0) continue;
    std::vector<int> stack{seed};
    std::vector<std::pair<int, int>> horizon;
    faces[seed].is_alive = false;
    while (!stack.empty()) {
      const Face face = faces[stack.back()];
      stack.pop_back();
      for (int c = 0; c < 3; ++c) {
        const int a = face.v[c], b = face.v[(c + 1) % 3];
        const int other = face_of_edge.at({b, a});
        if (!faces[other].is_alive) continue;
        if (sees(other, p)) {
          faces[other].is_alive = false;
          stack.push_back(other);
        } else {
          horizon.emplace_back(a, b);
        }
      }
    }
    for (const auto& [a, b] : horizon) add(a, b, p);
  }
  std::vector<Eigen::Vector3i> alive;
  for (const Face& f : faces)
    if (f.is_alive) alive.emplace_back(f.v[0], f.v[1], f.v[2]);
  Eigen::Matrix3Xi F(3, alive.size());
  for (size_t t = 0; t < alive.size(); ++t) F.col(t) = alive[t];
  return F;
}

SurfaceMesh spiral_sphere(int n) {
  Eigen::Matrix3Xd X(3, n);
  const double golden = kPi * (3 - std::sqrt(5.0));
  for (int i = 0; i < n; ++i) {
    const double z = 1 - (2 * i + 1.0) / n, r = std::sqrt(1 - z * z);
    X.col(i) << r * std::cos(golden * i), r * std::sin(golden * i), z;
  }
  return {X, convex_hull(X)};
}

struct Shape {
  std::string name;
  int least;  ///< vertices
};
const Shape kShapes[] = {{"ball", 12}, {"torus", 12}, {"bar", 8}, {"handle", 22}, {"head", 50}};

}  // namespace

const std::vector<std::string>& shape_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const Shape& shape : kShapes) all.push_back(shape.name);
    return all;
  }();
  return names;
}

SurfaceMesh make_shape(const std::string& name, int n_vertices, const Eigen::Vector3d& size) {
  const Shape* shape =
      std::find_if(std::begin(kShapes), std::end(kShapes), [&](auto& s) { return s.name == name; });
  if (shape == std::end(kShapes)) {
    std::string known;
    for (const Shape& s : kShapes) known += (known.empty() ? "" : ", ") + s.name;
    throw std::runtime_error("shape '" + name + "', expected one of " + known);
  }
  if (n_vertices < shape->least)
    throw std::runtime_error("n_vertices = " + std::to_string(n_vertices) + " for shape " + name +
                             ", expected at least " + std::to_string(shape->least));

  if (name == "bar") {
    const Eigen::Vector3d kDefault(4, 1, 1);
    return make_bar(n_vertices, (size.array() > 0).select(size, kDefault));
  }
  SurfaceMesh mesh =
      name == "ball"
          ? geodesic_sphere(std::max(1, static_cast<int>(std::lround(std::sqrt((n_vertices - 2) / 10.0)))))
      : name == "torus"  ? make_torus(n_vertices)
      : name == "handle" ? make_handle(n_vertices)
                         : make_head(n_vertices);
  const Eigen::Vector3d low = mesh.X.rowwise().minCoeff(), extent = mesh.X.rowwise().maxCoeff() - low;
  const Eigen::Vector3d factor =
      (size.array() > 0).select(size.cwiseQuotient(extent), Eigen::Vector3d::Ones());
  mesh.X = factor.asDiagonal() * mesh.X;
  return mesh;
}

}  // namespace testbed
