#include "fem_reference/solid/richardson.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "meshing/surface/surface.h"

namespace testbed::fem {

RefinementError richardson(const std::vector<Eigen::Matrix3Xd>& u, const SurfaceMesh& surface) {
  assert(u.size() >= 2);
  const Eigen::VectorXd w = vertex_areas(surface.X, surface.F);
  const auto norm = [&](const Eigen::Matrix3Xd& v) { return std::sqrt(v.colwise().squaredNorm().dot(w)); };
  const Eigen::Matrix3Xd& finest = u.back();
  const Eigen::Matrix3Xd last_change = finest - u[u.size() - 2];
  RefinementError error{2, false, 0, 0};
  if (u.size() > 2 && norm(last_change) > 0) {
    // Slower than first order would mean that extrapolation has nothing
    // to stand on; faster than the 8 of quadratic elements is chance.
    constexpr double kSlowest = 1.3, kFastest = 8;
    error.ratio = std::clamp(norm(u[u.size() - 2] - u[u.size() - 3]) / norm(last_change), kSlowest, kFastest);
    error.is_ratio_observed = true;
  }
  const Eigen::Matrix3Xd limit = finest + last_change / (error.ratio - 1);
  if (norm(limit) > 0) {  // a body without loads is at rest on every mesh
    error.of_first = norm(u.front() - limit) / norm(limit);
    error.of_last = norm(finest - limit) / norm(limit);
  }
  return error;
}

}  // namespace testbed::fem
