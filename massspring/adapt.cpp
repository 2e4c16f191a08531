#include "massspring/adapt.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/base/geometry.h"
#include "meshing/base/kd_tree.h"
#include "meshing/network/build_network.h"
#include "meshing/network/split_in_eight.h"
#include "meshing/surface/cut_surface.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::VectorXd;

/// Nodes of which eight times as many take some six gigabytes, at small strain twenty seconds.
Eigen::Index most_estimated(const Scene& scene) {
  return law_of(scene) == MaterialLaw::SmallStrain ? 60000 : 50000;
}

SpringNetwork network_on(const SurfaceMesh& surface, const Scene& scene) {
  return build_network(surface, scene.network, false, true);
}

/// Throws where it has none.
void balance(Simulation& simulation) {
  while (!simulation.has_ended()) simulation.advance();
  if (simulation.status() != Status::Ok)
    throw std::runtime_error("on " + std::to_string(simulation.model().network.X.cols()) +
                             " nodes, to estimate the error: " + simulation.report().reason);
}

/// One, but the scene's where there is friction, as what that holds depends on the way.
Scene in_fewest_steps(Scene scene) {
  if (!has_friction(scene)) scene.time.load_steps = 1;
  return scene;
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

}  // namespace

bool has_friction(const Scene& scene) {
  return std::any_of(scene.obstacles.begin(), scene.obstacles.end(),
                     [](const Obstacle& obstacle) { return obstacle.friction > 0; });
}

ErrorEstimate estimate_error(const Scene& scene, const SpringNetwork& network, const Matrix3Xd& u,
                             const Simulation* coarse) {
  // An error of a hundredth to two digits; at finite strain a slender body's loads are small beside its forces.
  const double residual = law_of(scene) == MaterialLaw::SmallStrain ? 1e-4 : 1e-6;
  const Eigen::Index most = most_estimated(scene);
  if (network.X.cols() > most)
    throw std::runtime_error(std::to_string(network.X.cols()) + " nodes, of at most " + std::to_string(most) +
                             " whose error is estimated");
  const auto [finer, between] = split_in_eight(network);
  Scene loosely = in_fewest_steps(scene);
  loosely.time.residual = std::max(residual, scene.time.residual);
  loosely.network.mass = MassMatrix::Lumped;  // what a consistent one takes to set up serves motions alone
  Simulation simulation(loosely, finer);
  if (!has_friction(scene)) {
    if (coarse) simulation.set_coarser(between, *coarse);
    simulation.start_at(interpolated(u, between));
  }
  balance(simulation);

  const Eigen::Index n = network.n_surface;
  const Matrix3Xd X = network.X.leftCols(n);
  const VectorXd areas = vertex_areas(X, network.F);
  Eigen::MatrixXd free(6, 0);
  if (simulation.equilibrium()->n_free_rigid_motions() > 0)
    free = free_motions(discretise(scene, {X, network.F}), X);
  const auto deformation = [&](const Matrix3Xd& v) -> VectorXd {
    return without_motions(v, X, areas, free).colwise().norm().transpose();
  };
  const auto norm = [&](const VectorXd& lengths) { return std::sqrt(lengths.cwiseAbs2().dot(areas)); };
  const Matrix3Xd of_finer = simulation.snapshot().u.leftCols(n);
  const double left =
      static_cast<double>(n) / finer.n_surface;  // part of the error that the finer network has
  const VectorXd error = deformation(u.leftCols(n) - of_finer) / (1 - left);
  const double size = norm(deformation(of_finer));
  if (size == 0) throw std::runtime_error("nothing deforms, so that no error is a part of it");
  return {norm(error) / size, error};
}

double edges_over_thickness(const SpringNetwork& network) {
  const SurfaceMesh surface{network.X.leftCols(network.n_surface), network.F};
  const VectorXd ratios = meshing::longest_edges(surface).cwiseQuotient(meshing::edges_across(surface, 1));
  const VectorXd areas = area_vectors(surface.X, surface.F).colwise().norm();
  std::vector<int> order(ratios.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return ratios[a] < ratios[b]; });
  double below = 0;
  for (const int f : order) {
    below += areas[f];
    if (below >= areas.sum() / 2) return ratios[f];
  }
  return 0;
}

AdaptedSurface adapt_surface(const Scene& scene, const SurfaceMesh& surface, double target) {
  AdaptedSurface adapted{surface, network_on(surface, scene), {}, {}, {}, false};
  while (true) {
    Simulation simulation(in_fewest_steps(scene), adapted.network);
    balance(simulation);
    const Matrix3Xd u = simulation.snapshot().u;
    adapted.estimate = estimate_error(scene, adapted.network, u, &simulation);
    adapted.errors.push_back(adapted.estimate.error);
    adapted.n_nodes.push_back(static_cast<int>(adapted.network.X.cols()));
    adapted.is_reached =
        adapted.estimate.error <= target && edges_over_thickness(adapted.network) <= kTooThin;
    if (adapted.is_reached) return adapted;
    SurfaceMesh finer = cut_where_strain_jumps(adapted.surface, jumps(adapted.network, u));
    SpringNetwork network = network_on(finer, scene);
    if (network.X.cols() > most_estimated(scene)) return adapted;
    adapted.surface = std::move(finer);
    adapted.network = std::move(network);
  }
}

}  // namespace testbed::massspring
