#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

void SurfaceHessian::clear() {
  diagonal.clear();
  pairs.clear();
}

void SurfaceHessian::scale(double factor) {
  for (Eigen::Matrix3d& block : diagonal) block *= factor;
  for (NearPair& pair : pairs) pair.stiffness *= factor;
}

void SurfaceHessian::add_diagonal(std::vector<Eigen::Matrix3d>& blocks) const {
  for (size_t i = 0; i < diagonal.size(); ++i) blocks[i] += diagonal[i];
  for (const NearPair& pair : pairs)
    for (int a = 0; a < 4; ++a)
      blocks[pair.node[a]] +=
          pair.stiffness * pair.weight[a] * pair.weight[a] * pair.normal * pair.normal.transpose();
}

}  // namespace testbed::meshing
