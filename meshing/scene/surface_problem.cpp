#include "meshing/scene/surface_problem.h"

#include <sstream>
#include <stdexcept>

#include "meshing/surface/surface.h"

namespace testbed::meshing {
namespace {

/// @param part  of the scene, whose region no such `piece` of the surface lies in
[[noreturn]] void refuse_empty(const Scene& scene, const std::string& part, const std::string& piece,
                               const SurfaceMesh& surface) {
  std::ostringstream what;
  const auto place = scene.places.find(part + ".region");
  if (place != scene.places.end()) what << place->second << ": ";
  what << part << ": no " << piece << " of the surface lies in its region; the body reaches from "
       << surface.X.rowwise().minCoeff().transpose() << " to " << surface.X.rowwise().maxCoeff().transpose();
  throw std::runtime_error(what.str());
}

}  // namespace

SurfaceProblem discretise(const Scene& scene, const SurfaceMesh& surface) {
  SurfaceProblem problem;
  for (size_t s = 0; s < scene.supports.size(); ++s) {
    const Support& support = scene.supports[s];
    std::vector<int> vertices = vertices_in(support.region, surface);
    if (vertices.empty()) refuse_empty(scene, "supports." + std::to_string(s), "node", surface);
    problem.held.push_back({std::move(vertices), support});
  }
  const Eigen::Index n = surface.F.cols();
  problem.traction = Eigen::Matrix3Xd::Zero(3, n);
  problem.follower_pressure = Eigen::VectorXd::Zero(n);
  const double factor = scene.loads.empty() ? 1 : load_factor_of(scene);
  const Eigen::Matrix3Xd normals = area_vectors(surface.X, surface.F).colwise().normalized();
  for (size_t l = 0; l < scene.loads.size(); ++l) {
    const Load& load = scene.loads[l];
    const std::vector<int> triangles = triangles_in(load.region, surface);
    const std::string name = "loads." + std::to_string(l);
    if (triangles.empty()) refuse_empty(scene, name, "triangle", surface);
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

Eigen::Vector3d displacement_at(const Support& support, const TimeOptions& time, double t) {
  if (!support.motion.empty()) return position_at(support.motion, t);
  return (time.mode == TimeMode::Dynamic ? t / time.end : t) * support.displacement;
}

std::string bytes_of(const SurfaceProblem& problem) {
  std::string bytes;
  const auto add = [&](const auto* values, size_t n) {
    bytes.append(reinterpret_cast<const char*>(values), n * sizeof *values);
  };
  for (const auto& [vertices, support] : problem.held) {
    add(vertices.data(), vertices.size());
    add(support.fixed.data(), support.fixed.size());
    add(support.displacement.data(), 3);
    for (const Eigen::Vector4d& point : support.motion) add(point.data(), 4);
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
