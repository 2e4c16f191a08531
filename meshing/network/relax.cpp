#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "meshing/base/kd_tree.h"
#include "meshing/base/random.h"
#include "meshing/network/network.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {

Eigen::Matrix3Xd relax_interior(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                                double least_depth, std::uint64_t seed, bool is_graded) {
  constexpr int kSteps = 10, kPointsPerNode = 32;
  const SurfaceTree tree(surface);
  const int n_surface = static_cast<int>(surface.X.cols()), n = n_surface + static_cast<int>(interior.cols());
  Eigen::Matrix3Xd sites(3, n);
  sites << surface.X, interior;

  // The body as random points, the same in every step.
  const Eigen::AlignedBox3d box(surface.X.rowwise().minCoeff(), surface.X.rowwise().maxCoeff());
  Random random(seed);
  Eigen::Matrix3Xd body(3, kPointsPerNode * interior.cols());
  for (int filled = 0; filled < body.cols();) {
    Eigen::Vector3d x = box.min();
    for (int axis = 0; axis < 3; ++axis) x[axis] += box.sizes()[axis] * random.uniform();
    if (tree.depth(x) > 0) body.col(filled++) = x;
  }
  // Sites of a centroidal Voronoi distribution lie as far apart as density^(-1/5) [Du & Gunzburger 2002].
  Eigen::VectorXd density = Eigen::VectorXd::Ones(body.cols());
  if (is_graded) {
    const KdTree vertices(surface.X);
    const Eigen::VectorXd spacing = vertex_areas(surface.X, surface.F).cwiseSqrt();
    for (int p = 0; p < body.cols(); ++p)
      density(p) = std::pow(spacing.mean() / spacing(vertices.nearest(body.col(p), 1)[0]), 5);
    // Lloyd's steps move nodes a cell or two, so these start as dense as they shall be: a draw by weights
    // w^(3/5), without replacement [Efraimidis & Spirakis 2006].
    std::vector<std::pair<double, int>> drawn;
    for (int p = 0; p < body.cols(); ++p)
      if (tree.depth(body.col(p)) >= least_depth)
        drawn.emplace_back(-std::log(1 - random.uniform()) / std::pow(density(p), 0.6), p);
    std::sort(drawn.begin(), drawn.end());
    for (int i = n_surface; i < n && i - n_surface < static_cast<int>(drawn.size()); ++i)
      sites.col(i) = body.col(drawn[i - n_surface].second);
  }
  for (int step = 0; step < kSteps; ++step) {
    const KdTree nodes(sites);
    Eigen::Matrix4Xd sum = Eigen::Matrix4Xd::Zero(4, n);  // of each site's points, and their weight
    for (int p = 0; p < body.cols(); ++p)
      sum.col(nodes.nearest(body.col(p), 1)[0]) += density(p) * body.col(p).homogeneous();
    for (int i = n_surface; i < n; ++i)
      if (sum(3, i) > 0) {
        const Eigen::Vector3d centre = sum.col(i).hnormalized();
        if (tree.depth(centre) >= least_depth) sites.col(i) = centre;
      }
  }
  return sites.rightCols(interior.cols());
}

}  // namespace testbed::meshing
