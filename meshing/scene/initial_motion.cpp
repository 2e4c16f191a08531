#include "meshing/scene/initial_motion.h"

#include <Eigen/Geometry>
#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

Eigen::Matrix3Xd initial_velocity(const Scene& scene, const Eigen::Matrix3Xd& X,
                                  const Eigen::VectorXd& mass) {
  Eigen::Matrix3Xd velocity = Eigen::Matrix3Xd::Zero(3, X.cols());
  for (size_t k = 0; k < scene.initial.size(); ++k) {
    const InitialMotion& initial = scene.initial[k];
    const std::vector<int> nodes = nodes_in(initial.region, X);
    if (nodes.empty()) {
      std::ostringstream what;
      what << "initial." << k << ": no node lies in its region, expected one that meets the body, from ("
           << X.rowwise().minCoeff().transpose() << ") to (" << X.rowwise().maxCoeff().transpose() << ") m";
      throw std::runtime_error(what.str());
    }
    const Eigen::Vector3d centre = X(Eigen::all, nodes) * mass(nodes) / mass(nodes).sum();
    for (const int i : nodes) velocity.col(i) += initial.velocity + initial.spin.cross(X.col(i) - centre);
  }
  return velocity;
}

}  // namespace testbed::meshing
