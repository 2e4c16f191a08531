#include <Eigen/Geometry>

#include "meshing/kd_tree.h"
#include "meshing/network.h"
#include "meshing/random.h"
#include "meshing/surface_tree.h"

namespace testbed {

Eigen::Matrix3Xd relax_interior(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                                double least_depth, std::uint64_t seed) {
  constexpr int n_steps = 10, points_per_node = 32;
  const SurfaceTree tree(surface);
  const int n_surface = static_cast<int>(surface.X.cols()), n = n_surface + static_cast<int>(interior.cols());
  Eigen::Matrix3Xd sites(3, n);
  sites << surface.X, interior;

  // The body as random points, the same in every step.
  const Eigen::AlignedBox3d box(surface.X.rowwise().minCoeff(), surface.X.rowwise().maxCoeff());
  Random random(seed);
  Eigen::Matrix3Xd body(3, points_per_node * interior.cols());
  for (int filled = 0; filled < body.cols();) {
    Eigen::Vector3d x = box.min();
    for (int axis = 0; axis < 3; ++axis) x[axis] += box.sizes()[axis] * random.uniform();
    if (tree.depth(x) > 0) body.col(filled++) = x;
  }
  for (int step = 0; step < n_steps; ++step) {
    const KdTree nodes(sites);
    Eigen::Matrix4Xd sum = Eigen::Matrix4Xd::Zero(4, n);  // of each site's points, and their number
    for (const auto& x : body.colwise()) sum.col(nodes.nearest(x, 1)[0]) += x.homogeneous();
    for (int i = n_surface; i < n; ++i)
      if (sum(3, i) > 0) {
        const Eigen::Vector3d centre = sum.col(i).hnormalized();
        if (tree.depth(centre) >= least_depth) sites.col(i) = centre;
      }
  }
  return sites.rightCols(interior.cols());
}

}  // namespace testbed
