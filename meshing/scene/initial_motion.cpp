#include "meshing/scene/initial_motion.h"

#include <Eigen/Geometry>
#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

Eigen::Matrix3Xd initial_velocity(const Scene& scene, const Eigen::Matrix3Xd& X, const Eigen::VectorXd& mass,
                                  const Box& body,
                                  const std::function<void(Eigen::Ref<Eigen::VectorXd>)>& add_up) {
  Eigen::Matrix3Xd velocity = Eigen::Matrix3Xd::Zero(3, X.cols());
  for (size_t k = 0; k < scene.initial.size(); ++k) {
    const InitialMotion& initial = scene.initial[k];
    const std::vector<int> nodes = nodes_in(initial.region, X, body);
    Eigen::VectorXd sums(5);  // of positions by masses, masses and nodes
    sums << X(Eigen::all, nodes) * mass(nodes), mass(nodes).sum(), static_cast<double>(nodes.size());
    add_up(sums);
    if (sums(4) == 0) {
      std::ostringstream what;
      what << "initial." << k << ": no node lies in its region, expected one that meets the body, from ("
           << body.low.transpose() << ") to (" << body.high.transpose() << ") m";
      throw std::runtime_error(what.str());
    }
    const Eigen::Vector3d centre = sums.head<3>() / sums(3);
    for (const int i : nodes) velocity.col(i) += initial.velocity + initial.spin.cross(X.col(i) - centre);
  }
  return velocity;
}

}  // namespace testbed::meshing
