#include "meshing/network/connect.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "meshing/base/kd_tree.h"
#include "meshing/base/names.h"
#include "meshing/network/delaunay.h"
#include "meshing/surface/surface.h"

namespace testbed::meshing {

namespace {

using Pairs = std::vector<std::pair<int, int>>;

/// The surface's edges first, then the other links in ascending order, each once.
SpringNetwork assemble(const SurfaceMesh& surface, Eigen::Matrix3Xd X, Pairs links) {
  Pairs edges, others;
  const Eigen::Matrix2Xi E = edges_of(surface.F);
  for (const auto& e : E.colwise()) edges.emplace_back(e[0], e[1]);
  std::sort(links.begin(), links.end());
  links.erase(std::unique(links.begin(), links.end()), links.end());
  std::set_difference(links.begin(), links.end(), edges.begin(), edges.end(), std::back_inserter(others));
  edges.insert(edges.end(), others.begin(), others.end());
  SpringNetwork network{
      std::move(X), surface.F, Eigen::Matrix2Xi(2, edges.size()), {}, static_cast<int>(surface.X.cols())};
  for (size_t s = 0; s < edges.size(); ++s) network.E.col(s) << edges[s].first, edges[s].second;
  return network;
}

Pairs all_pairs(int n) {
  constexpr double kMostPairs = 2e7;  // a model keeps some 100 bytes for each spring
  if (0.5 * n * (n - 1.0) > kMostPairs)
    throw std::runtime_error("complete connectivity of " + std::to_string(n) + " nodes has " +
                             std::to_string(static_cast<long>(0.5 * n * (n - 1.0))) +
                             " springs, expected at most 20000000");
  Pairs pairs;
  for (int i = 0; i < n; ++i)
    for (int j = i + 1; j < n; ++j) pairs.emplace_back(i, j);
  return pairs;
}

void drop_outside(const SurfaceTree& tree, const Eigen::Matrix3Xd& X, int n_surface, Pairs& links) {
  links.erase(std::remove_if(
                  links.begin(), links.end(),
                  [&](const auto& link) { return !is_inside(tree, X, n_surface, link.first, link.second); }),
              links.end());
}

/// How far a node's links leave the plane nearest to them (root mean square).
double degrees_from_plane(const Eigen::Matrix3Xd& X, const Pairs& links, int node) {
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  int n = 0;
  for (const auto& [i, j] : links) {
    if (i != node && j != node) continue;
    const Eigen::Vector3d d = (X.col(j) - X.col(i)).normalized();
    spread += d * d.transpose();
    ++n;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread, Eigen::EigenvaluesOnly);
  return std::asin(std::sqrt(std::max(solver.eigenvalues()[0], 0.) / n)) * 180 / 3.14159265358979323846;
}

SpringNetwork complete_pcp(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                           const ConnectOptions& options, PcpReport* report) {
  if (options.neighbours < 1)
    throw std::runtime_error("neighbours = " + std::to_string(options.neighbours) + ", expected at least 1");
  SpringNetwork pcp = link_pcp(surface, interior, options.pcp, report);
  const Eigen::Matrix2Xi edges = edges_of(surface.F);
  Pairs links;
  for (const auto& e : pcp.E.rightCols(pcp.E.cols() - edges.cols()).colwise()) links.emplace_back(e[0], e[1]);
  const KdTree nodes(pcp.X);
  for (int i = 0; i < pcp.X.cols(); ++i)
    for (int j : nodes.nearest(pcp.X.col(i), options.neighbours + 1))
      if (j != i) links.emplace_back(std::min(i, j), std::max(i, j));
  std::sort(links.begin(), links.end());
  links.erase(std::unique(links.begin(), links.end()), links.end());
  const SurfaceTree tree(surface);
  drop_outside(tree, pcp.X, pcp.n_surface, links);
  for (const auto& e : edges.colwise()) links.emplace_back(e[0], e[1]);
  std::sort(links.begin(), links.end());
  links.erase(std::unique(links.begin(), links.end()), links.end());
  const std::vector<int> loose = make_rigid(surface, tree, pcp.X, links);
  if (!loose.empty()) {
    std::ostringstream what;
    what << "completed PCP: no link inside the solid holds " << loose.size() << " nodes; the first, node "
         << loose[0] << " at (" << pcp.X.col(loose[0]).transpose() << "), has its links within "
         << degrees_from_plane(pcp.X, links, loose[0])
         << " degrees of a plane: the surface folds onto itself there, and the vertex must be moved or "
            "removed";
    throw std::runtime_error(what.str());
  }
  return assemble(surface, std::move(pcp.X), std::move(links));
}

}  // namespace

Connectivity connectivity_of(const std::string& name) {
  if (const auto found = value_of<Connectivity>(name)) return *found;
  throw std::runtime_error("connectivity '" + name + "'" + suggestion(name, all_names<Connectivity>()));
}

bool is_inside(const SurfaceTree& tree, const Eigen::Matrix3Xd& X, int n_surface, int i, int j) {
  const Eigen::Vector3d a = X.col(i), b = X.col(j);
  const bool is_on_i = i < n_surface, is_on_j = j < n_surface;
  if (tree.crosses(a, b, is_on_i ? i : -1, is_on_j ? j : -1)) return false;
  return !(is_on_i && is_on_j) || tree.depth((a + b) / 2) > 0;
}

SpringNetwork connect(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                      const ConnectOptions& options, PcpReport* report) {
  const int n_surface = static_cast<int>(surface.X.cols());
  Eigen::Matrix3Xd X(3, n_surface + interior.cols());
  X << surface.X, interior;
  switch (options.connectivity) {
    case Connectivity::Surface:
      return assemble(surface, surface.X, {});
    case Connectivity::Central: {
      Eigen::Matrix3Xd with_centre(3, n_surface + 1);
      with_centre << surface.X, surface.X.rowwise().mean();
      Pairs spokes;
      for (int i = 0; i < n_surface; ++i) spokes.emplace_back(i, n_surface);
      return assemble(surface, with_centre, spokes);
    }
    case Connectivity::Complete:
      return assemble(surface, X, all_pairs(static_cast<int>(X.cols())));
    case Connectivity::Delaunay: {
      Pairs edges = delaunay_edges(X);
      drop_outside(SurfaceTree(surface), X, n_surface, edges);
      return assemble(surface, X, edges);
    }
    case Connectivity::Pcp:
      return link_pcp(surface, interior, options.pcp, report);
    case Connectivity::CompletedPcp:
      return complete_pcp(surface, interior, options, report);
  }
  throw std::logic_error("unknown connectivity");
}

}  // namespace testbed::meshing
