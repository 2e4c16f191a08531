#include "meshing/tetrahedralize.h"

#include <gmsh.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <stdexcept>
#include <string>
#include <unordered_map>
#include <vector>

#include "meshing/shells.h"
#include "meshing/surface.h"

namespace testbed {

namespace {

/// gmsh holds one global model: alive from construction to destruction.
struct GmshSession {
  GmshSession() {
    gmsh::initialize(0, nullptr, false);
    gmsh::option::setNumber("General.Terminal", 0);
    gmsh::option::setNumber("General.NumThreads", 1);
    gmsh::logger::start();
  }
  ~GmshSession() {
    gmsh::logger::stop();
    gmsh::finalize();
  }
};

std::string errors_of_log() {
  std::vector<std::string> log;
  gmsh::logger::get(log);
  std::string text;
  for (const std::string& line : log)
    if (line.rfind("Error", 0) == 0 || line.rfind("Warning", 0) == 0)
      text += (text.empty() ? "" : "; ") + line;
  return text.empty() ? "gmsh gives no message" : text;
}

/// Gives the surface to gmsh as discrete entities: one per shell (in a single one, Delaunay fills cavities),
/// and one volume for each outward shell with the cavities in it. Node i gets tag i + 1. Returns the volumes'
/// tags.
std::vector<int> add_surface(const SurfaceMesh& surface) {
  const std::vector<Shell> shells = shells_of(surface);
  std::vector<std::vector<int>> loops(shells.size());  // loops of the volume that each outward shell bounds
  for (size_t s = 0; s < shells.size(); ++s) {
    const int entity = gmsh::model::addDiscreteEntity(2);
    std::vector<std::size_t> corners, vertices;
    for (int f : shells[s].triangles)
      for (int v : surface.F.col(f)) corners.push_back(v + 1);
    vertices = corners;
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    std::vector<double> coordinates;
    for (std::size_t v : vertices) {
      const auto x = surface.X.col(v - 1);
      coordinates.insert(coordinates.end(), {x[0], x[1], x[2]});
    }
    gmsh::model::mesh::addNodes(2, entity, vertices, coordinates);
    gmsh::model::mesh::addElementsByType(entity, 2, {}, corners);
    const int loop = gmsh::model::geo::addSurfaceLoop({entity});
    const bool is_cavity = shells[s].depth % 2 == 1;
    auto& loops_of_solid = loops[is_cavity ? shells[s].parent : s];
    loops_of_solid.insert(is_cavity ? loops_of_solid.end() : loops_of_solid.begin(), loop);
  }
  std::vector<int> volumes;
  for (const auto& solid : loops)
    if (!solid.empty()) volumes.push_back(gmsh::model::geo::addVolume(solid));
  return volumes;
}

/// Gives gmsh one discrete entity for each point, whose nodes get the tags from `first_tag` on.
std::vector<int> add_points(const Eigen::Matrix3Xd& points, std::size_t first_tag) {
  std::vector<int> entities;
  for (std::size_t i = 0; i < static_cast<std::size_t>(points.cols()); ++i) {
    entities.push_back(gmsh::model::addDiscreteEntity(0));
    gmsh::model::mesh::addNodes(0, entities.back(), {first_tag + i},
                                {points(0, i), points(1, i), points(2, i)});
    gmsh::model::mesh::addElementsByType(entities.back(), 15, {}, {first_tag + i});
  }
  return entities;
}

/// Reads the tetrahedra back: surface vertices first, then the interior points wanted (tags in `kept`), then
/// gmsh's own.
TetMesh collect(const SurfaceMesh& surface, std::size_t n_kept) {
  std::vector<std::size_t> element_tags, corners, node_tags;
  std::vector<double> coordinates, unused;
  gmsh::model::mesh::getElementsByType(4, element_tags, corners);
  gmsh::model::mesh::getNodes(node_tags, coordinates, unused);
  std::unordered_map<std::size_t, size_t> position;
  for (size_t i = 0; i < node_tags.size(); ++i) position[node_tags[i]] = i;

  const std::size_t n_surface = surface.X.cols();
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < n_surface + n_kept; ++i) order.push_back(i + 1);
  std::vector<std::size_t> own = corners;
  std::sort(own.begin(), own.end());
  own.erase(std::unique(own.begin(), own.end()), own.end());
  order.insert(order.end(), std::upper_bound(own.begin(), own.end(), n_surface + n_kept), own.end());

  TetMesh mesh;
  mesh.n_surface = static_cast<int>(n_surface);
  mesh.F = surface.F;
  mesh.X.resize(3, order.size());
  std::unordered_map<std::size_t, int> index;
  for (size_t i = 0; i < order.size(); ++i) {
    index[order[i]] = static_cast<int>(i);
    mesh.X.col(i) = Eigen::Map<const Eigen::Vector3d>(&coordinates[3 * position.at(order[i])]);
  }
  mesh.T.resize(4, corners.size() / 4);
  for (size_t c = 0; c < corners.size(); ++c) mesh.T(c % 4, c / 4) = index.at(corners[c]);
  return mesh;
}

}  // namespace

TetMesh tetrahedralize(const SurfaceMesh& surface, const TetOptions& options) {
  check_closed(surface, "surface to tetrahedralize");
  GmshSession session;
  try {
    gmsh::option::setNumber("Mesh.Optimize", 1);
    gmsh::option::setNumber("Mesh.Renumber", 0);  // tags are how nodes are known again
    if (options.interior_size) gmsh::option::setNumber("Mesh.MeshSizeMax", *options.interior_size);
    const std::vector<int> volumes = add_surface(surface);
    const std::vector<int> points = add_points(options.interior, surface.X.cols() + 1);
    gmsh::model::geo::synchronize();
    for (int volume : volumes)
      if (!points.empty()) gmsh::model::mesh::embed(0, points, 3, volume);
    gmsh::model::mesh::generate(3);
    TetMesh mesh = collect(surface, options.interior.cols());
    check_tetrahedra(mesh, surface);
    return mesh;
  } catch (const std::string& message) {
    throw std::runtime_error("gmsh: " + message + " (" + errors_of_log() + ")");
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(std::string(error.what()) + " (" + errors_of_log() + ")");
  }
}

void check_tetrahedra(const TetMesh& mesh, const SurfaceMesh& surface) {
  constexpr double rounding = 1e-9;  // of the total volume, for the sum of many tetrahedra
  const auto& [X, T, F, n_surface] = mesh;
  auto fail = [](const std::string& message) { throw std::runtime_error("tetrahedra: " + message); };
  if (T.cols() == 0) fail("none were made");
  if (X.leftCols(surface.X.cols()) != surface.X) fail("surface vertices moved");

  double total = 0;
  std::map<std::array<int, 3>, std::array<int, 3>> open_faces;  // sorted corners -> corners seen from outside
  for (int t = 0; t < T.cols(); ++t) {
    const double V = tet_volume(X, T.col(t));
    if (!(V > 0))
      fail("tetrahedron " + std::to_string(t) + " has volume " + std::to_string(V) + ", expected > 0");
    total += V;
    for (const auto& face : {std::array{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}}) {
      const std::array<int, 3> corners{T(face[0], t), T(face[1], t), T(face[2], t)};
      std::array<int, 3> key = corners;
      std::sort(key.begin(), key.end());
      const auto [entry, is_new] = open_faces.try_emplace(key, corners);
      if (!is_new) open_faces.erase(entry);
    }
  }
  const double expected = volume(surface.X, surface.F);
  if (!(std::abs(total - expected) <= rounding * expected))
    fail("they fill " + std::to_string(total / expected) + " of the surface's volume, expected 1");
  auto rotate = [](std::array<int, 3> f) {
    std::rotate(f.begin(), std::min_element(f.begin(), f.end()), f.end());
    return f;
  };
  for (int f = 0; f < surface.F.cols(); ++f) {
    std::array<int, 3> key{surface.F(0, f), surface.F(1, f), surface.F(2, f)};
    const std::array<int, 3> triangle = rotate(key);
    std::sort(key.begin(), key.end());
    const auto entry = open_faces.find(key);
    if (entry == open_faces.end() || rotate(entry->second) != triangle)
      fail("surface triangle " + std::to_string(f) + " is not on their boundary");
    open_faces.erase(entry);
  }
  if (!open_faces.empty())
    fail(std::to_string(open_faces.size()) + " boundary faces are not surface triangles");
}

double tet_volume(const Eigen::Matrix3Xd& X, const Eigen::Vector4i& tet) {
  const Eigen::Vector3d a = X.col(tet[0]);
  return (X.col(tet[1]) - a).cross(X.col(tet[2]) - a).dot(X.col(tet[3]) - a) / 6;
}

}  // namespace testbed
