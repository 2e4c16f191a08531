// A small network of springs for tests: five nodes, all pairs joined, stretched and compressed.
#pragma once

#include "massspring/model.h"
#include "meshing/random.h"

namespace testbed {

inline Eigen::Matrix3Xd random_points(int n, double size, std::uint64_t seed) {
  Random random(seed);
  Eigen::Matrix3Xd x(3, n);
  for (double& c : x.reshaped()) c = size * (2 * random.uniform() - 1);
  return x;
}

/// A tetrahedron with a node inside; E = 3 kg-scale masses differ so that mistakes in them show.
inline MassSpringModel small_model(double stiffness = 40) {
  MassSpringModel model;
  model.network.X.resize(3, 5);
  model.network.X << 0, 1, 0, 0, 0.2,  //
      0, 0, 1, 0, 0.3,                 //
      0, 0, 0, 1, 0.25;
  model.network.F.resize(3, 4);
  model.network.F << 0, 0, 0, 1,  //
      2, 1, 3, 2,                 //
      1, 3, 2, 3;
  model.network.E.resize(2, 10);
  model.network.E << 0, 0, 0, 1, 1, 2, 0, 1, 2, 3,  //
      1, 2, 3, 2, 3, 3, 4, 4, 4, 4;
  model.network.n_surface = 4;
  model.mass = (Eigen::VectorXd(5) << 1, 1.5, 2, 0.5, 1).finished();
  model.springs = Springs{model.network.E, Eigen::VectorXd::LinSpaced(10, stiffness, 2 * stiffness), 0};
  return model;
}

inline Forces no_forces(const MassSpringModel& model) {
  Forces forces;
  forces.load = Eigen::Matrix3Xd::Zero(3, model.network.X.cols());
  return forces;
}

}  // namespace testbed
