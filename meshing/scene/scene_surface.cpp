// Where a scene meets its surface: loading it, and picking parts of it.
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "meshing/scene/scene.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"

namespace testbed::meshing {
namespace {

bool is_inside(const Everywhere&, const Eigen::Vector3d&, double) {
  return true;
}
bool is_inside(const Box& box, const Eigen::Vector3d& x, double slack) {
  return ((x - box.low).array() >= -slack).all() && ((box.high - x).array() >= -slack).all();
}
bool is_inside(const HalfSpace& half, const Eigen::Vector3d& x, double slack) {
  return (x - half.point).dot(half.normal.normalized()) <= slack;
}
bool is_inside(const Ball& ball, const Eigen::Vector3d& x, double slack) {
  return (x - ball.centre).norm() <= ball.radius + slack;
}

using Shape = decltype(Region::shape);

Shape absolute(const Everywhere& everywhere, const Eigen::Vector3d&, const Eigen::Vector3d&) {
  return everywhere;
}
Shape absolute(const Box& box, const Eigen::Vector3d& low, const Eigen::Vector3d& extent) {
  return Box{low + extent.cwiseProduct(box.low), low + extent.cwiseProduct(box.high)};
}
Shape absolute(const HalfSpace& half, const Eigen::Vector3d& low, const Eigen::Vector3d& extent) {
  return HalfSpace{low + extent.cwiseProduct(half.point), half.normal};
}
Shape absolute(const Ball& ball, const Eigen::Vector3d& low, const Eigen::Vector3d& extent) {
  return Ball{low + extent.cwiseProduct(ball.centre), ball.radius * extent.minCoeff()};
}

std::vector<bool> membership(const Region& region, const Eigen::Matrix3Xd& X, const Box& body) {
  const Eigen::Vector3d extent = body.high - body.low;
  const auto shape =
      region.relative
          ? std::visit([&](const auto& s) -> Shape { return absolute(s, body.low, extent); }, region.shape)
          : region.shape;
  constexpr double kSlack = 1e-9;  // of the bounding box: a vertex placed on the region's boundary is inside
  std::vector<bool> is_member(X.cols());
  for (int i = 0; i < X.cols(); ++i)
    is_member[i] =
        std::visit([&](const auto& s) { return is_inside(s, X.col(i), kSlack * extent.norm()); }, shape);
  return is_member;
}

/// Right-handed: what was z is y.
Eigen::Matrix3Xd turned_upright(const Eigen::Matrix3Xd& X) {
  Eigen::Matrix3Xd turned(3, X.cols());
  turned << X.row(0), X.row(2), -X.row(1);
  return turned;
}

double metres_of(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::Centimetre:
      return 0.01;
    case LengthUnit::Millimetre:
      return 0.001;
    case LengthUnit::Inch:
      return 0.0254;
    default:
      return 1;
  }
}

const std::string kMending =
    "; ./testbed meshing check FILE lists all faults, ./testbed meshing repair FILE OUT mends exactly what "
    "is "
    "turned round, inside out or doubled, ./testbed remesh FILE OUT makes a new surface of the rest within a "
    "tolerance";

/// The vertices that a surface had before it was cut.
Eigen::Matrix3Xd before(const SurfaceMesh& surface) {
  return surface.X.leftCols(surface.cuts.F.maxCoeff() + 1);
}

bool are_members(const Eigen::Vector3i& vertices, const std::vector<bool>& is_member) {
  return is_member[vertices[0]] && is_member[vertices[1]] && is_member[vertices[2]];
}

}  // namespace

SurfaceMesh load_surface(const SurfaceSource& source) {
  SurfaceMesh surface = source.file.empty() ? make_shape(source.shape, source.n_vertices, source.size)
                                            : read_surface(source.file);
  if (source.file.empty())
    check_closed(surface, source.shape);
  else
    try {
      check_closed(surface, source.file);
    } catch (const std::runtime_error& error) {
      throw std::runtime_error(error.what() + kMending);
    }
  constexpr double kThinnest =
      1e-6;  // of its largest side: networks and meshers fill what is thinner with nodes for ever
  const Eigen::Vector3d box = surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff();
  if (box.minCoeff() < kThinnest * box.maxCoeff()) {
    std::ostringstream what;
    what << (source.file.empty() ? source.shape : source.file) << ": measures " << box(0) << " x " << box(1)
         << " x " << box(2) << ", expected a body no thinner than a millionth of its size";
    throw std::runtime_error(what.str());
  }
  if (source.up == UpAxis::Z) surface.X = turned_upright(surface.X);
  surface.X *= source.scale * metres_of(source.unit);
  if (source.normalise) {
    const Eigen::Vector3d low = surface.X.rowwise().minCoeff(), high = surface.X.rowwise().maxCoeff();
    surface.X.colwise() -= (low + high) / 2;
    surface.X /= (high - low).minCoeff();
  }
  return surface;
}

CutSurface cut_for(const Scene& scene, const SurfaceMesh& surface, double coarser) {
  std::vector<std::vector<bool>> parts;
  const Box body = box_of(surface.X);
  const auto add = [&](const Region& region) { parts.push_back(membership(region, surface.X, body)); };
  for (const Support& support : scene.supports) add(support.region);
  for (const Seam& seam : scene.seams) {
    add(seam.from);
    add(seam.to);
  }
  for (const Load& load : scene.loads) add(load.region);
  for (const Handle& handle : scene.handles)
    if (!handle.vertex) add(handle.region);
  auto [cut, is_bounded] = cut_across(surface, scene.surface.across, coarser, parts);
  for (int i = 0; i < scene.surface.at_supports; ++i) {
    std::vector<bool> is_at_border(cut.X.cols()), is_near = is_at_border;
    for (const Support& support : scene.supports) {
      std::vector<bool> is_held(cut.X.cols());
      for (const int v : vertices_in(support.region, cut)) is_held[v] = true;
      for (const auto& t : cut.F.colwise())
        if (!are_members(t, is_held))
          for (const int v : t) is_at_border[v] = is_at_border[v] || is_held[v];
    }
    for (const auto& t : cut.F.colwise())
      if (is_at_border[t[0]] || is_at_border[t[1]] || is_at_border[t[2]])
        for (const int v : t) is_near[v] = true;
    Eigen::VectorXd longest = longest_edges(cut);
    for (Eigen::Index f = 0; f < longest.size(); ++f)
      if (is_near[cut.F(0, f)] || is_near[cut.F(1, f)] || is_near[cut.F(2, f)]) longest[f] /= 2;
    cut = cut_surface(cut, longest, std::numeric_limits<int>::max());
  }
  return {std::move(cut), is_bounded};
}

Box box_of(const Eigen::Matrix3Xd& X) {
  return {X.rowwise().minCoeff(), X.rowwise().maxCoeff()};
}

std::vector<int> nodes_in(const Region& region, const Eigen::Matrix3Xd& X, const Box& body) {
  const std::vector<bool> is_member = membership(region, X, body);
  std::vector<int> nodes;
  for (int i = 0; i < X.cols(); ++i)
    if (is_member[i]) nodes.push_back(i);
  return nodes;
}

std::vector<int> vertices_in(const Region& region, const SurfaceMesh& surface) {
  if (surface.cuts.F.size() == 0) return nodes_in(region, surface.X, box_of(surface.X));
  const Eigen::Matrix3Xd X = before(surface);
  const std::vector<bool> is_member = membership(region, X, box_of(X));
  std::vector<int> vertices;
  for (int v = 0; v < surface.X.cols(); ++v)
    if (are_members(surface.cuts.between.col(v), is_member)) vertices.push_back(v);
  return vertices;
}

std::vector<int> triangles_in(const Region& region, const SurfaceMesh& surface) {
  const bool is_cut = surface.cuts.F.size() > 0;
  const Eigen::Matrix3Xd X = is_cut ? before(surface) : surface.X;
  const std::vector<bool> is_member = membership(region, X, box_of(X));
  std::vector<int> triangles;
  for (int f = 0; f < surface.F.cols(); ++f)
    if (are_members(is_cut ? surface.cuts.F.col(surface.cuts.parent[f]) : surface.F.col(f), is_member))
      triangles.push_back(f);
  return triangles;
}

}  // namespace testbed::meshing
