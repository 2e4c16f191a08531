#include "meshing/tetrahedra/tet_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "meshing/base/geometry.h"
#include "meshing/surface/surface.h"

namespace testbed::meshing {

namespace {

/// Faces of a tetrahedron, counter-clockwise seen from outside.
constexpr int kFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};

using Face = std::array<int, 3>;

/// The same triangle with its least corner first.
Face rotated(Face f) {
  std::rotate(f.begin(), std::min_element(f.begin(), f.end()), f.end());
  return f;
}

/// Faces that belong to one tetrahedron only, in ascending order.
std::vector<Face> boundary_faces(const Eigen::Matrix4Xi& T) {
  std::vector<std::pair<Face, Face>> all;  // sorted corners, corners seen from outside
  all.reserve(4 * T.cols());
  for (const auto& tet : T.colwise())
    for (const auto& face : kFaces) {
      const Face seen = rotated({tet[face[0]], tet[face[1]], tet[face[2]]});
      Face key = seen;
      std::sort(key.begin(), key.end());
      all.emplace_back(key, seen);
    }
  std::sort(all.begin(), all.end());
  std::vector<Face> open;
  for (size_t begin = 0, end; begin < all.size(); begin = end) {
    for (end = begin; end < all.size() && all[end].first == all[begin].first;) ++end;
    if (end - begin == 1) open.push_back(all[begin].second);
    if (end - begin > 2) throw std::runtime_error("tetrahedra: a face belongs to more than two of them");
  }
  std::sort(open.begin(), open.end());
  return open;
}

}  // namespace

void check_tetrahedra(const TetMesh& mesh, const SurfaceMesh& surface) {
  constexpr double kRounding = 1e-9;  // of the total volume, for the sum of many tetrahedra
  const auto& [X, T, F, n_surface] = mesh;
  auto fail = [](const std::string& message) { throw std::runtime_error("tetrahedra: " + message); };
  if (T.cols() == 0) fail("none were made");
  if (n_surface != surface.X.cols() || X.leftCols(n_surface) != surface.X) fail("surface vertices moved");
  if (F != surface.F) fail("boundary triangles are not the surface's");

  std::vector<bool> has_some(X.cols());
  for (int v : T.reshaped()) has_some[v] = true;
  if (const auto lone = std::find(has_some.begin(), has_some.end(), false); lone != has_some.end())
    fail("node " + std::to_string(lone - has_some.begin()) + " is a corner of none");

  double total = 0;
  for (int t = 0; t < T.cols(); ++t) {
    const double V = tet_volume(X, T.col(t));
    if (!(V > 0))
      fail("tetrahedron " + std::to_string(t) + " has volume " + std::to_string(V) + ", expected > 0");
    total += V;
  }
  const double expected = volume(surface.X, surface.F);
  if (!(std::abs(total - expected) <= kRounding * expected))
    fail("they fill " + std::to_string(total / expected) + " of the surface's volume, expected 1");

  const std::vector<Face> found = boundary_faces(T);
  std::vector<Face> wanted;
  for (const auto& f : surface.F.colwise()) wanted.push_back(rotated({f[0], f[1], f[2]}));
  std::sort(wanted.begin(), wanted.end());
  if (found != wanted) {
    std::vector<Face> missing;
    std::set_difference(wanted.begin(), wanted.end(), found.begin(), found.end(),
                        std::back_inserter(missing));
    fail(std::to_string(missing.size()) + " surface triangles are not on their boundary, which has " +
         std::to_string(found.size()) + " faces, expected " + std::to_string(wanted.size()));
  }
}

TetQuality tet_quality(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T) {
  constexpr double kDegrees = 180 / 3.14159265358979323846, kSliver = 0.05;
  TetQuality quality{180, 1, 0, 0};
  for (const auto& tet : T.colwise()) {
    const double V = tet_volume(X, tet);
    Eigen::Matrix<double, 3, 4> normals;  // area vectors of the faces
    for (int f = 0; f < 4; ++f) {
      const Eigen::Vector3d a = X.col(tet[kFaces[f][0]]);
      normals.col(f) = (X.col(tet[kFaces[f][1]]) - a).cross(X.col(tet[kFaces[f][2]]) - a) / 2;
    }
    for (int f = 0; f < 4; ++f)
      for (int g = 0; g < f; ++g) {
        const Eigen::Vector3d m = normals.col(f), n = normals.col(g);
        quality.min_dihedral =
            std::min(quality.min_dihedral, 180 - kDegrees * std::atan2(m.cross(n).norm(), m.dot(n)));
      }
    const Eigen::Vector3d a = X.col(tet[1]) - X.col(tet[0]), b = X.col(tet[2]) - X.col(tet[0]),
                          c = X.col(tet[3]) - X.col(tet[0]);
    const double inscribed = 3 * V / normals.colwise().norm().sum();
    const double circumscribed =
        (a.squaredNorm() * b.cross(c) + b.squaredNorm() * c.cross(a) + c.squaredNorm() * a.cross(b)).norm() /
        (12 * V);
    const double ratio = 3 * inscribed / circumscribed;
    quality.min_radius_ratio = std::min(quality.min_radius_ratio, ratio);
    quality.mean_radius_ratio += ratio / T.cols();
    const double longest =
        std::max({a.norm(), b.norm(), c.norm(), (a - b).norm(), (b - c).norm(), (c - a).norm()});
    quality.n_slivers += 6 * std::sqrt(2.0) * V / std::pow(longest, 3) < kSliver;
  }
  return quality;
}

}  // namespace testbed::meshing
