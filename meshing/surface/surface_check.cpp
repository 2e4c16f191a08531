#include "meshing/surface/surface_check.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "meshing/surface/shells.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_faults.h"

namespace testbed::meshing {

namespace {

double aspect(const Eigen::Matrix3Xd& X, const Eigen::Vector3i& f) {
  const Eigen::Vector3d a = X.col(f[0]), b = X.col(f[1]), c = X.col(f[2]);
  const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
  return longest * longest / (b - a).cross(c - a).norm();
}

std::vector<double> to_list(const Eigen::Vector3d& x) {
  return {x[0], x[1], x[2]};
}

}  // namespace

Needles needles_of(const SurfaceMesh& surface) {
  Needles needles;
  for (const auto& f : surface.F.colwise()) {
    const double value = aspect(surface.X, f);
    needles.n += value > kNeedleAspect;
    needles.worst = std::max(needles.worst, value);
  }
  return needles;
}

SurfaceReport report_surface(const SurfaceMesh& surface, int n_merged) {
  const Eigen::Matrix3Xd& X = surface.X;
  const Eigen::Matrix3Xi& F = surface.F;
  const Eigen::Matrix2Xi E = edges_of(F);
  const SurfaceFaults faults = find_faults(surface);
  const bool is_sound = faults.is_closed() && faults.is_manifold() && faults.disoriented_edges.empty();
  const std::vector<Shell> shells = shells_of(surface);
  const Needles needles = needles_of(surface);
  const Eigen::ArrayXd lengths = (X(Eigen::all, E.row(0)) - X(Eigen::all, E.row(1))).colwise().norm();

  SurfaceReport report;
  report.problems = describe(faults, surface);
  auto& values = report.values;
  values["vertices"] = X.cols();
  values["merged_vertices"] = n_merged;
  values["faces"] = F.cols();
  values["edges"] = E.cols();
  values["components"] = shells.size();
  const long n_used = X.cols() - static_cast<long>(faults.unused_vertices.size());
  if (is_sound) values["genus"] = static_cast<long>(shells.size()) - (n_used - E.cols() + F.cols()) / 2;
  values["closed"] = faults.is_closed() && faults.crowded_edges.empty();
  values["manifold"] = faults.is_manifold();
  values["consistently_oriented"] = faults.disoriented_edges.empty();
  if (is_sound) values["outward"] = faults.misturned_triangles.empty();
  values["open_edges"] = faults.open_edges.size();
  values["edges_with_more_than_two_triangles"] = faults.crowded_edges.size();
  values["split_vertices"] = faults.split_vertices.size();
  values["disoriented_edges"] = faults.disoriented_edges.size();
  values["unused_vertices"] = faults.unused_vertices.size();
  values["doubled_triangles"] = faults.doubled_triangles.size();
  values["degenerate_triangles"] = faults.degenerate_triangles.size();
  values["sliver_triangles"] = needles.n;
  if (is_sound && faults.degenerate_triangles.empty()) {
    const auto pairs = self_intersections(surface);
    values["self_intersections"] = pairs.size();
    if (!pairs.empty()) {
      const auto [f, g] = pairs.front();
      report.problems.push_back(std::to_string(pairs.size()) + " pairs of triangles intersect, first " +
                                std::to_string(f) + " and " + std::to_string(g) + " at vertex " +
                                vertex_text(surface, F(0, f)));
    }
  }
  if (is_sound) values["volume"] = volume(X, F);
  values["area"] = area(X, F);
  values["box_low"] = to_list(X.rowwise().minCoeff());
  values["box_high"] = to_list(X.rowwise().maxCoeff());
  values["edge_shortest"] = lengths.minCoeff();
  values["edge_mean"] = lengths.mean();
  values["edge_longest"] = lengths.maxCoeff();
  if (std::isfinite(needles.worst)) values["worst_aspect"] = needles.worst;
  values["usable"] = report.problems.empty();
  return report;
}

}  // namespace testbed::meshing
