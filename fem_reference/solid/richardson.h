// The error of a solution, estimated from the same problem on refined meshes.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::fem {

struct RefinementError {
  double ratio;            ///< by which a refinement reduces the error
  bool is_ratio_observed;  ///< from three solutions; otherwise 2, first order, is supposed
  double of_first;         ///< estimated error, area-weighted L2, relative to the extrapolated displacement
  double of_last;
};

/// Richardson extrapolation of surface displacements (3 x n_surface each, at least 2) on meshes refined once
/// more each, rigid motion taken out by the caller.
RefinementError richardson(const std::vector<Eigen::Matrix3Xd>& u, const SurfaceMesh& surface);

}  // namespace testbed::fem
