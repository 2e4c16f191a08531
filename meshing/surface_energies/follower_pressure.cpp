#include "meshing/surface_energies/follower_pressure.h"

#include <map>

#include "meshing/surface/surface.h"

namespace testbed::meshing {

Eigen::VectorXi FollowerPressure::face(Eigen::Index t) const {
  Eigen::VectorXi nodes(middles.cols() > 0 ? 6 : 3);
  nodes.head<3>() = F.col(t);
  if (nodes.size() == 6) nodes.tail<3>() = middles.col(t);
  return nodes;
}

std::vector<FollowerPressure> followers_of(const Eigen::VectorXd& pressure, const Eigen::MatrixXi& faces) {
  std::map<double, std::vector<int>> triangles;
  for (int f = 0; f < pressure.size(); ++f)
    if (pressure(f) != 0) triangles[pressure(f)].push_back(f);
  std::vector<FollowerPressure> followers;
  for (const auto& [p, of_p] : triangles) {
    followers.push_back({p, faces.topRows<3>()(Eigen::all, of_p)});
    if (faces.rows() == 6) followers.back().middles = faces.bottomRows<3>()(Eigen::all, of_p);
  }
  return followers;
}

double energy(const FollowerPressure& follower, const Eigen::Matrix3Xd& x) {
  if (follower.middles.cols() == 0) return follower.pressure * volume(x, follower.F);
  double V = 0;
  for (Eigen::Index t = 0; t < follower.F.cols(); ++t)
    V += enclosed_volume(x(Eigen::all, follower.face(t))).volume;
  return follower.pressure * V;
}

void add_forces(const FollowerPressure& follower, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f,
                double factor) {
  if (follower.middles.cols() == 0) {
    Eigen::Matrix3Xd gradient;
    volume_and_gradient(follower.F, x, gradient);
    f.leftCols(gradient.cols()) -= factor * follower.pressure * gradient;
    return;
  }
  for (Eigen::Index t = 0; t < follower.F.cols(); ++t) {
    const Eigen::VectorXi face = follower.face(t);
    f(Eigen::all, face) -= factor * follower.pressure * enclosed_volume(x(Eigen::all, face)).gradient;
  }
}

}  // namespace testbed::meshing
