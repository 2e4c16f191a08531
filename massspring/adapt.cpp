#include "massspring/adapt.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/geometry.h"
#include "meshing/base/kd_tree.h"
#include "meshing/network/build_network.h"
#include "meshing/surface/cut_surface.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::VectorXd;

SpringNetwork network_on(const SurfaceMesh& surface, const Scene& scene) {
  return build_network(surface, scene.network, false, true);
}

struct Equilibrium {
  Matrix3Xd u;
  bool is_free;
};

Equilibrium solve(Scene scene, const SpringNetwork& network) {
  scene.time.load_steps = 1;
  Simulation simulation(scene, network);
  simulation.advance();
  if (simulation.report().status != Status::Ok)
    throw std::runtime_error("on " + std::to_string(network.X.cols()) +
                             " nodes, to estimate the error: " + simulation.report().reason);
  return {simulation.snapshot().u, simulation.equilibrium()->n_free_rigid_motions() > 0};
}

/// The distance of two displacements at the vertices of a surface, the first of the other's, over the finer one.
ErrorEstimate distance(const SurfaceMesh& surface, const Equilibrium& coarse, const Equilibrium& fine) {
  const Eigen::Index n = surface.X.cols();
  const VectorXd areas = vertex_areas(surface.X, surface.F);
  const auto deformation = [&](const Matrix3Xd& u) -> Matrix3Xd {
    return coarse.is_free ? without_rigid_motion(u, surface.X, areas) : u;
  };
  const auto norm = [&](const VectorXd& lengths) { return std::sqrt(lengths.cwiseAbs2().dot(areas)); };
  const VectorXd difference =
      deformation(coarse.u.leftCols(n) - fine.u.leftCols(n)).colwise().norm().transpose();
  return {norm(difference) / norm(deformation(fine.u.leftCols(n)).colwise().norm().transpose()), difference};
}

/// For each vertex of the surface, squared jumps of the displacement's gradient between the tetrahedra that are
/// nearest to it and their nodes' averages, times volume [Zienkiewicz & Zhu 1987].
VectorXd jumps(const SpringNetwork& network, const Matrix3Xd& u) {
  const auto& [X, F, E, T, n_surface, cuts] = network;
  std::vector<Matrix3d> of_node(X.cols(), Matrix3d::Zero()), of_tet;
  VectorXd volume = VectorXd::Zero(X.cols());
  for (const auto& t : T.colwise()) {
    const double V = tet_volume(X, t);
    of_tet.emplace_back(u(Eigen::all, t) * barycentric_gradients(X, t).transpose());
    for (const int i : t) {
      of_node[i] += V * of_tet.back();
      volume[i] += V;
    }
  }
  const Matrix3Xd on_surface = X.leftCols(n_surface);
  const KdTree tree(on_surface);
  VectorXd result = VectorXd::Zero(n_surface);
  for (Eigen::Index k = 0; k < T.cols(); ++k)
    for (const int i : T.col(k)) {
      const double jump = tet_volume(X, T.col(k)) * (of_tet[k] - of_node[i] / volume[i]).squaredNorm();
      result[i < n_surface ? i : tree.nearest(X.col(i), 1).front()] += jump;
    }
  return result;
}

/// Cuts the triangles that have the largest jumps at their vertices, a given part of all.
SurfaceMesh cut_where_strain_jumps(const SurfaceMesh& surface, const VectorXd& jumps) {
  constexpr double kPart = 0.5;  // [Doerfler 1996]
  std::vector<int> order(surface.F.cols());
  std::iota(order.begin(), order.end(), 0);
  VectorXd valence = VectorXd::Zero(surface.X.cols()), of_triangle(surface.F.cols());
  for (const int v : surface.F.reshaped()) valence[v] += 1;
  for (Eigen::Index f = 0; f < of_triangle.size(); ++f)
    of_triangle[f] = jumps.cwiseQuotient(valence)(surface.F.col(f)).sum();
  std::sort(order.begin(), order.end(), [&](int a, int b) { return of_triangle[a] > of_triangle[b]; });
  VectorXd longest = VectorXd::Constant(surface.F.cols(), std::numeric_limits<double>::infinity());
  const VectorXd edges = longest_edges(surface);
  double sum = 0;
  for (const int f : order) {
    if (sum > kPart * of_triangle.sum()) break;
    sum += of_triangle[f];
    longest[f] = 0.5 * edges[f];
  }
  return cut_surface(surface, longest, std::numeric_limits<int>::max());
}

/// Part of a network's error that a finer one has, if errors fall with the square of the surface's edges.
double left_of_error(const SpringNetwork& coarse, const SpringNetwork& finer) {
  return static_cast<double>(coarse.n_surface) / finer.n_surface;
}

ErrorEstimate scaled(const ErrorEstimate& estimate, double factor) {
  return {factor * estimate.error, factor * estimate.of_vertex};
}

}  // namespace

ErrorEstimate estimate_error(const Scene& scene, const SurfaceMesh& surface, const SpringNetwork& network) {
  const SpringNetwork finer =
      network_on(cut_surface(surface, longest_edges(surface) / 2, std::numeric_limits<int>::max()), scene);
  const ErrorEstimate apart = distance(surface, solve(scene, network), solve(scene, finer));
  return scaled(apart, 1 / (1 - left_of_error(network, finer)));
}

AdaptedSurface adapt_surface(const Scene& scene, const SurfaceMesh& surface, double target) {
  constexpr Eigen::Index kMostNodes = 200000;
  AdaptedSurface adapted{surface, network_on(surface, scene), {}, {}, {}, false};
  Equilibrium before = solve(scene, adapted.network);
  adapted.n_nodes.push_back(static_cast<int>(adapted.network.X.cols()));
  while (!adapted.is_reached && adapted.network.X.cols() < kMostNodes) {
    const SurfaceMesh coarse = adapted.surface;
    adapted.surface = cut_where_strain_jumps(coarse, jumps(adapted.network, before.u));
    SpringNetwork finer = network_on(adapted.surface, scene);
    const Equilibrium now = solve(scene, finer);
    const double left = left_of_error(adapted.network, finer);
    adapted.estimate = scaled(distance(coarse, before, now), left / (1 - left));
    adapted.network = std::move(finer);
    adapted.errors.push_back(adapted.estimate.error);
    adapted.n_nodes.push_back(static_cast<int>(adapted.network.X.cols()));
    adapted.is_reached = adapted.estimate.error <= target;
    before = now;
  }
  return adapted;
}

}  // namespace testbed::massspring
