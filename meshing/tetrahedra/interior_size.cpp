#include "meshing/tetrahedra/interior_size.h"

#include <Eigen/Geometry>

#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {

namespace {

/// Sum of the area vectors at each vertex: the direction out of the body (m2).
Eigen::Matrix3Xd outward(const SurfaceMesh& surface) {
  Eigen::Matrix3Xd sum = Eigen::Matrix3Xd::Zero(3, surface.X.cols());
  const Eigen::Matrix3Xd areas = area_vectors(surface.X, surface.F);
  for (int f = 0; f < surface.F.cols(); ++f)
    for (int v : surface.F.col(f)) sum.col(v) += areas.col(f);
  return sum;
}

}  // namespace

Eigen::VectorXd vertex_spacing(const SurfaceMesh& surface) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(surface.X.cols()), count = sum;
  const Eigen::Matrix2Xi edges = edges_of(surface.F);
  for (const auto& e : edges.colwise()) {
    const double length = (surface.X.col(e[0]) - surface.X.col(e[1])).norm();
    for (int v : e) {
      sum[v] += length;
      count[v] += 1;
    }
  }
  return sum.cwiseQuotient(count);
}

Eigen::VectorXd interior_size(const SurfaceMesh& surface, double part) {
  constexpr double kLayers = 4, kLeast = 0.5;
  constexpr int kHalvings = 5;
  const SurfaceTree tree(surface);
  const Eigen::Matrix3Xd inward = -outward(surface).colwise().normalized();
  Eigen::VectorXd size = part * vertex_spacing(surface);
  for (int v = 0; v < size.size(); ++v) {
    const Eigen::Vector3d x = surface.X.col(v);
    const auto fits = [&](double h) { return !tree.crosses(x, x + kLayers * h * inward.col(v), v); };
    if (fits(size[v])) continue;
    double low = kLeast * size[v], high = size[v];
    for (int i = 0; i < kHalvings; ++i) (fits((low + high) / 2) ? low : high) = (low + high) / 2;
    size[v] = low;
  }
  return size;
}

Eigen::VectorXd largest_size(const SurfaceMesh& surface) {
  const double diagonal = (surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff()).norm();
  return Eigen::VectorXd::Constant(surface.X.cols(), diagonal);
}

}  // namespace testbed::meshing
