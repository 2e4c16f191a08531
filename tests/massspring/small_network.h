// A small network of springs for tests: five nodes, all pairs joined, stretched and compressed.
#pragma once

#include <cmath>

#include "massspring/model/model.h"
#include "meshing/base/random.h"

namespace testbed::massspring {

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
  Eigen::Matrix2Xi E(2, 10);
  E << 0, 0, 0, 1, 1, 2, 0, 1, 2, 3,  //
      1, 2, 3, 2, 3, 3, 4, 4, 4, 4;
  model.network.n_surface = 4;
  model.mass = (Eigen::VectorXd(5) << 1, 1.5, 2, 0.5, 1).finished();
  model.springs = Springs{E, Eigen::VectorXd::LinSpaced(10, stiffness, 2 * stiffness), 0};
  return model;
}

/// Two triangles of springs, an edge of one (nodes 0 and 1) `gap` above that of the other (nodes 3 and 4),
/// their middles above each other, turned by `angle` about z; all else lies far apart.
inline MassSpringModel crossing_triangles(double angle, double gap) {
  const double c = std::cos(angle), s = std::sin(angle);
  MassSpringModel model;
  model.network.X.resize(3, 6);
  model.network.X << -1, 1, 0, -c, c, 0,  //
      0, 0, -1, -s, s, 1,                 //
      gap, gap, gap + 1, 0, 0, -1;
  model.network.F.resize(3, 2);
  model.network.F << 0, 3,  //
      1, 4,                 //
      2, 5;
  Eigen::Matrix2Xi E(2, 6);
  E << 0, 1, 2, 3, 4, 5,  //
      1, 2, 0, 4, 5, 3;
  model.network.n_surface = 6;
  model.material.E = 1e3;
  model.mass = Eigen::VectorXd::LinSpaced(6, 1, 2);
  model.springs = Springs{E, Eigen::VectorXd::LinSpaced(6, 40, 80), 0};
  return model;
}

inline Forces no_forces(const MassSpringModel& model) {
  Forces forces;
  forces.load = Eigen::Matrix3Xd::Zero(3, model.network.X.cols());
  return forces;
}

}  // namespace testbed::massspring
