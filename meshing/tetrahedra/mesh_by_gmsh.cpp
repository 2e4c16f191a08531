// The mesher of gmsh_worker.
#include <gmsh.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>
#include <vector>

#include "meshing/surface/shells.h"
#include "meshing/surface/surface_tree.h"
#include "meshing/tetrahedra/tet_worker.h"

namespace testbed::meshing {

namespace {

/// Edges inside are as long as wanted at the surface nearby,
/// or this part of the distance to it: three layers are fine.
constexpr double kGrowth = 0.3;

/// One volume of gmsh: an outward shell and the cavities in it.
struct Solid {
  int volume;
  std::vector<int> shells;
};

/// Gives the surface to gmsh: a discrete entity for each shell (in a single one, Delaunay fills cavities) and
/// a volume for each solid. Node i gets tag i + 1.
std::vector<Solid> add_surface(const SurfaceMesh& surface, const std::vector<Shell>& shells) {
  std::vector<int> loops;
  for (const Shell& shell : shells) {
    const int entity = gmsh::model::addDiscreteEntity(2);
    std::vector<std::size_t> corners;
    for (int f : shell.triangles)
      for (int v : surface.F.col(f)) corners.push_back(v + 1);
    std::vector<std::size_t> vertices = corners;
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    std::vector<double> coordinates;
    for (std::size_t v : vertices) {
      const auto x = surface.X.col(v - 1);
      coordinates.insert(coordinates.end(), {x[0], x[1], x[2]});
    }
    gmsh::model::mesh::addNodes(2, entity, vertices, coordinates);
    gmsh::model::mesh::addElementsByType(entity, 2, {}, corners);
    loops.push_back(gmsh::model::geo::addSurfaceLoop({entity}));
  }
  std::vector<Solid> solids;
  for (int s = 0; s < static_cast<int>(shells.size()); ++s) {
    if (shells[s].depth % 2 == 1) continue;
    Solid solid{0, {s}};
    for (int c = 0; c < static_cast<int>(shells.size()); ++c)
      if (shells[c].depth % 2 == 1 && shells[c].parent == s) solid.shells.push_back(c);
    std::vector<int> loops_of_solid;
    for (int shell : solid.shells) loops_of_solid.push_back(loops[shell]);
    solid.volume = gmsh::model::geo::addVolume(loops_of_solid);
    solids.push_back(solid);
  }
  return solids;
}

/// Gives gmsh the points that lie in each solid (the one that the triangle nearest to it bounds),
/// as one discrete entity: one for each point takes time as the
/// square of their number. Nodes get the tags from `first_tag` on.
void add_points(const Eigen::Matrix3Xd& points, std::size_t first_tag, const SurfaceTree& tree,
                const std::vector<Shell>& shells, const std::vector<Solid>& solids) {
  std::map<int, int> solid_of;  // by triangle
  for (size_t s = 0; s < solids.size(); ++s)
    for (int shell : solids[s].shells)
      for (int f : shells[shell].triangles) solid_of[f] = static_cast<int>(s);
  std::vector<std::vector<std::size_t>> tags(solids.size());
  std::vector<std::vector<double>> coordinates(solids.size());
  for (int i = 0; i < points.cols(); ++i) {
    const int s = solid_of.at(tree.nearest(points.col(i)).triangle);
    tags[s].push_back(first_tag + i);
    coordinates[s].insert(coordinates[s].end(), points.col(i).begin(), points.col(i).end());
  }
  for (size_t s = 0; s < solids.size(); ++s) {
    if (tags[s].empty()) continue;
    const int entity = gmsh::model::addDiscreteEntity(0);
    gmsh::model::mesh::addNodes(0, entity, tags[s], coordinates[s]);
    gmsh::model::mesh::addElementsByType(entity, 15, {}, tags[s]);
    gmsh::model::geo::synchronize();
    gmsh::model::mesh::embed(0, {entity}, 3, solids[s].volume);
  }
}

/// Weights of a triangle's corners (columns) at a point of it.
Eigen::Vector3d barycentric(const Eigen::Vector3d& x, const Eigen::Matrix3d& corners) {
  Eigen::Vector3d weights;
  for (int c = 0; c < 3; ++c)
    weights[c] = (corners.col((c + 1) % 3) - x).cross(corners.col((c + 2) % 3) - x).norm();
  return weights / weights.sum();
}

/// Reads the tetrahedra back: surface vertices first, then the points given, then gmsh's own.
TetNodes collect(std::size_t n_given) {
  std::vector<std::size_t> element_tags, corners, node_tags;
  std::vector<double> coordinates, unused;
  gmsh::model::mesh::getElementsByType(4, element_tags, corners);
  gmsh::model::mesh::getNodes(node_tags, coordinates, unused);
  std::unordered_map<std::size_t, size_t> position;
  for (size_t i = 0; i < node_tags.size(); ++i) position[node_tags[i]] = i;

  std::vector<std::size_t> order, own = corners;
  for (std::size_t tag = 1; tag <= n_given; ++tag) order.push_back(tag);
  std::sort(own.begin(), own.end());
  own.erase(std::unique(own.begin(), own.end()), own.end());
  order.insert(order.end(), std::upper_bound(own.begin(), own.end(), n_given), own.end());

  TetNodes nodes{Eigen::Matrix3Xd(3, order.size()), Eigen::Matrix4Xi(4, corners.size() / 4)};
  std::unordered_map<std::size_t, int> index;
  for (size_t i = 0; i < order.size(); ++i) {
    index[order[i]] = static_cast<int>(i);
    nodes.X.col(i) = Eigen::Map<const Eigen::Vector3d>(&coordinates[3 * position.at(order[i])]);
  }
  for (size_t c = 0; c < corners.size(); ++c) nodes.T(c % 4, c / 4) = index.at(corners[c]);
  return nodes;
}

}  // namespace

TetNodes mesh_task(const TetTask& task, int algorithm, double angle_tolerance) {
  gmsh::initialize(0, nullptr, false);
  auto set = [](const char* option, double value) { gmsh::option::setNumber(option, value); };
  set("General.NumThreads", 1);  // HXT with two once left cracks without an error
  set("Mesh.Algorithm3D", algorithm);
  set("Mesh.AngleToleranceFacetOverlap", angle_tolerance);
  set("Mesh.Optimize", 1);
  set("Mesh.Renumber", 0);  // tags are how nodes are known again
  set("Mesh.MeshSizeExtendFromBoundary", 0);

  const std::vector<Shell> shells = shells_of(task.surface);
  const std::vector<Solid> solids = add_surface(task.surface, shells);
  gmsh::model::geo::synchronize();
  const SurfaceTree tree(task.surface);
  add_points(task.interior, task.surface.X.cols() + 1, tree, shells, solids);

  const double longest = task.longest > 0 ? task.longest : std::numeric_limits<double>::max();
  gmsh::model::mesh::setSizeCallback([&](int, int, double x, double y, double z) {
    const SurfaceTree::Nearest nearest = tree.nearest({x, y, z});
    const Eigen::Vector3i corners = task.surface.F.col(nearest.triangle);
    const auto weights = barycentric(nearest.point, task.surface.X(Eigen::all, corners));
    const double size = weights.dot(task.size(corners));
    return std::min(longest, std::max(size, kGrowth * nearest.distance));
  });
  gmsh::model::mesh::generate(3);
  return collect(task.surface.X.cols() + task.interior.cols());
}

}  // namespace testbed::meshing
