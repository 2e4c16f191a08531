#include "meshing/scene/surface_problem.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <memory>
#include <sstream>
#include <stdexcept>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/kd_tree.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {
namespace {

/// In front of a message; empty for a key that was not given.
std::string place_of(const Scene& scene, const std::string& key) {
  const auto place = scene.places.find(key);
  return place == scene.places.end() ? "" : place->second + ": ";
}

/// @param region  of the scene, which no such `piece` of the surface lies in
[[noreturn]] void refuse_empty(const Scene& scene, const std::string& region, const std::string& piece,
                               const SurfaceMesh& surface) {
  std::ostringstream what;
  what << place_of(scene, region) << region << ": no " << piece
       << " of the surface lies there; the body reaches from " << surface.X.rowwise().minCoeff().transpose()
       << " to " << surface.X.rowwise().maxCoeff().transpose();
  throw std::runtime_error(what.str());
}

/// Each vertex of one region tied to the nearest of the other.
void add_stitches(const Scene& scene, size_t k, const SurfaceMesh& surface,
                  std::vector<SurfaceProblem::Stitch>& stitches) {
  const auto& [from, to, stiffness] = scene.seams[k];
  const std::string name = "seams." + std::to_string(k);
  const std::vector<int> first = vertices_in(from, surface), second = vertices_in(to, surface);
  if (first.empty()) refuse_empty(scene, name + ".from", "node", surface);
  if (second.empty()) refuse_empty(scene, name + ".to", "node", surface);
  const Eigen::Matrix3Xd ends = surface.X(Eigen::all, second);
  const KdTree tree(ends);
  for (const int a : first) {
    const int b = second[tree.nearest(surface.X.col(a), 1)[0]];
    if (a == b) {
      std::ostringstream what;
      what << name << ": from and to both hold the node at (" << surface.X.col(a).transpose()
           << ") m, expected no node in common";
      throw std::runtime_error(what.str());
    }
    stitches.push_back({a, b, stiffness});
  }
}

std::vector<int> handled_vertices(const Scene& scene, size_t k, const SurfaceMesh& surface) {
  const Handle& handle = scene.handles[k];
  const std::string name = "handles." + std::to_string(k);
  if (handle.vertex && *handle.vertex >= surface.X.cols())
    throw std::runtime_error(place_of(scene, name + ".vertex") + name +
                             ".vertex = " + std::to_string(*handle.vertex) + ", expected below " +
                             std::to_string(surface.X.cols()) + ", the vertices of the surface");
  std::vector<int> vertices =
      handle.vertex ? std::vector<int>{*handle.vertex} : vertices_in(handle.region, surface);
  if (vertices.empty()) refuse_empty(scene, name + ".region", "node", surface);
  return vertices;
}

}  // namespace

SurfaceProblem discretise(const Scene& scene, const SurfaceMesh& surface) {
  SurfaceProblem problem;
  for (size_t s = 0; s < scene.supports.size(); ++s) {
    const Support& support = scene.supports[s];
    std::vector<int> vertices = vertices_in(support.region, surface);
    if (vertices.empty()) refuse_empty(scene, "supports." + std::to_string(s) + ".region", "node", surface);
    problem.constrained.push_back({std::move(vertices), support});
  }
  for (size_t k = 0; k < scene.seams.size(); ++k) add_stitches(scene, k, surface, problem.stitches);
  for (size_t k = 0; k < scene.handles.size(); ++k)
    problem.held.push_back({handled_vertices(scene, k, surface), scene.handles[k]});
  const Eigen::Index n = surface.F.cols();
  problem.traction = Eigen::Matrix3Xd::Zero(3, n);
  problem.follower_pressure = Eigen::VectorXd::Zero(n);
  const double factor = scene.loads.empty() ? 1 : load_factor_of(scene);
  const Eigen::Matrix3Xd normals = area_vectors(surface.X, surface.F).colwise().normalized();
  for (size_t l = 0; l < scene.loads.size(); ++l) {
    const Load& load = scene.loads[l];
    const std::vector<int> triangles = triangles_in(load.region, surface);
    const std::string name = "loads." + std::to_string(l);
    if (triangles.empty()) refuse_empty(scene, name + ".region", "triangle", surface);
    if (load.is_follower && !is_closed(surface.F(Eigen::all, triangles)))
      throw std::runtime_error(
          name + ".follower = true, expected a region that holds whole components of the surface");
    for (const int f : triangles) {
      problem.traction.col(f) += factor * load.traction;
      if (load.is_follower)
        problem.follower_pressure(f) += factor * load.pressure;
      else
        problem.traction.col(f) -= factor * load.pressure * normals.col(f);
    }
    if (load.stress.empty()) continue;
    problem.stressed.push_back({triangles, load.stress});
    for (StressTerm& term : problem.stressed.back().terms) term.tail<6>() *= factor;
  }
  return problem;
}

Eigen::MatrixXd free_motions(const SurfaceProblem& problem, const Eigen::Matrix3Xd& X) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  const double size = (X.colwise() - centre).colwise().norm().maxCoeff();
  Eigen::Matrix<double, 6, 6> constrained = Eigen::Matrix<double, 6, 6>::Zero();
  for (const auto& [vertices, support] : problem.constrained)
    for (const Eigen::Vector3d& direction : constrained_directions(support))
      for (const int v : vertices) {
        const Eigen::Vector<double, 6> held =
            rigid_motions_at((X.col(v) - centre) / size).transpose() * direction;
        constrained += held * held.transpose();
      }
  Eigen::MatrixXd motions = free_combinations(constrained);
  motions.bottomRows<3>() /= size;
  motions.topRows<3>() += cross_product_matrix(centre) * motions.bottomRows<3>();
  return motions;
}

Eigen::Vector3d displacement_at(const Support& support, const TimeOptions& time, double t) {
  if (!support.motion.empty()) return position_at(support.motion, t);
  return (time.mode == TimeMode::Dynamic ? t / time.end : t) * support.displacement;
}

std::vector<Eigen::Vector3d> constrained_directions(const Support& support) {
  if (support.normal) return {support.normal->normalized()};
  if (support.along) {
    const Eigen::Vector3d across = support.along->unitOrthogonal();
    return {across, support.along->normalized().cross(across)};
  }
  std::vector<Eigen::Vector3d> directions;
  for (int c = 0; c < 3; ++c)
    if (support.fixed[c]) directions.emplace_back(Eigen::Vector3d::Unit(c));
  return directions;
}

bool holds_at(const Support& support, double t) {
  constexpr double kRounding = 1e-9;  // of times that are sums of steps
  return !support.end || t < *support.end * (1 - kRounding);
}

std::function<double(const Eigen::Vector3d& X)> collapsing_part(const Collapse& collapse,
                                                                const SurfaceMesh& surface) {
  if (collapse.surface) return [](const Eigen::Vector3d&) { return 1.; };
  const Eigen::Matrix2Xi E = edges_of(surface.F);
  const double edge =
      (surface.X(Eigen::all, E.row(0)) - surface.X(Eigen::all, E.row(1))).colwise().norm().mean();
  return [tree = std::make_shared<const SurfaceTree>(surface), depth = collapse.depth.value_or(edge)](
             const Eigen::Vector3d& X) { return std::min(1., tree->nearest(X).distance / depth); };
}

std::optional<Eigen::Matrix3d> frame_of(const std::vector<Support>& supports) {
  constexpr double kRounding = 1e-9;
  std::vector<Eigen::Vector3d> axes;
  for (const Support& support : supports) {
    const std::vector<Eigen::Vector3d> constrained = constrained_directions(support);
    if (constrained.size() == 3) continue;  // in every frame
    const Eigen::Vector3d axis =
        constrained.size() == 1 ? constrained[0] : constrained[0].cross(constrained[1]);
    bool is_new = true;
    for (const Eigen::Vector3d& other : axes) {
      const double cosine = std::abs(axis.dot(other));
      if (cosine > kRounding && cosine < 1 - kRounding) return {};
      if (cosine >= 1 - kRounding) is_new = false;
    }
    if (is_new) axes.push_back(axis);
  }
  const bool is_aligned = std::all_of(axes.begin(), axes.end(), [](const Eigen::Vector3d& axis) {
    return axis.cwiseAbs().maxCoeff() > 1 - kRounding;
  });
  if (is_aligned) return Eigen::Matrix3d::Identity();
  if (axes.size() == 1) axes.emplace_back(axes[0].unitOrthogonal());
  Eigen::Matrix3d frame;
  frame << axes[0], axes[1], axes[0].cross(axes[1]);
  return frame;
}

std::string bytes_of(const SurfaceProblem& problem) {
  std::string bytes;
  const auto add = [&](const auto* values, size_t n) {
    bytes.append(reinterpret_cast<const char*>(values), n * sizeof *values);
  };
  for (const auto& [vertices, support] : problem.constrained) {
    add(vertices.data(), vertices.size());
    for (const Eigen::Vector3d& direction : constrained_directions(support)) add(direction.data(), 3);
    if (support.end) add(&*support.end, 1);
    add(support.displacement.data(), 3);
    for (const Eigen::Vector4d& point : support.motion) add(point.data(), 4);
  }
  for (const auto& [vertices, handle] : problem.held) {
    add(vertices.data(), vertices.size());
    for (const double* value : {&handle.stiffness, &handle.start}) add(value, 1);
    if (handle.end) add(&*handle.end, 1);
    for (const Eigen::Vector4d& point : handle.motion) add(point.data(), 4);
  }
  add(problem.traction.data(), problem.traction.size());
  for (const auto& [triangles, terms] : problem.stressed) {
    add(triangles.data(), triangles.size());
    for (const StressTerm& term : terms) add(term.data(), term.size());
  }
  add(problem.follower_pressure.data(), problem.follower_pressure.size());
  return bytes;
}

}  // namespace testbed::meshing
