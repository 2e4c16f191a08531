#include "meshing/surface_energies/follower_pressure.h"

#include <map>

namespace testbed::meshing {

double FollowerPressure::energy(const Eigen::Matrix3Xd& x) const {
  return factor_ * (pressure_ * volume_of(faces_, x));
}

void FollowerPressure::add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const {
  Eigen::Matrix3Xd gradient;
  volume_and_gradient(faces_, x, gradient);
  f.leftCols(gradient.cols()) -= factor_ * pressure_ * gradient;
}

void FollowerPressure::add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const {
  if (curvature != Curvature::Projected) H.add_volume(factor_ * pressure_, faces_, x);
}

SurfaceEnergies followers_of(const Eigen::VectorXd& pressure, const Eigen::MatrixXi& faces) {
  std::map<double, std::vector<int>> triangles;
  for (int f = 0; f < pressure.size(); ++f)
    if (pressure(f) != 0) triangles[pressure(f)].push_back(f);
  SurfaceEnergies followers;
  for (const auto& [p, of_p] : triangles)
    followers.push_back(std::make_shared<FollowerPressure>(p, faces_of(faces(Eigen::all, of_p))));
  return followers;
}

}  // namespace testbed::meshing
