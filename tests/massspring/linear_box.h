// A jittered box of tetrahedra as a model of any calibration, linear about rest.
#pragma once

#include <string>
#include <vector>

#include "massspring/calibrations/calibrate.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {

/// 0.5 m x 0.25 m x 0.25 m of rubber, m cubes along its short sides.
inline MassSpringModel full_box(const std::string& calibration, int m = 2, double E = 1e6, double nu = 0.25) {
  const TetMesh mesh = meshing::box_tets(2 * m, m, m, 0.25 / m, 0.2);
  SpringNetwork network;
  network.X = mesh.X;
  network.F = mesh.F;
  network.T = mesh.T;
  network.n_surface = static_cast<int>(mesh.X.cols());
  return calibrate(network, {E, nu, 1000, 0}, find_calibration(calibration));
}

inline MassSpringModel linear_box(const std::string& calibration, int m = 2, double E = 1e6,
                                  double nu = 0.25) {
  MassSpringModel model = full_box(calibration, m, E, nu);
  linearise(model);
  return model;
}

/// Gravity of a magnitude across the box, clamped where x is least.
inline Forces hanging(const MassSpringModel& model, double gravity = 9.81) {
  Forces forces;
  forces.load = Eigen::Vector3d(0, -gravity, 0.3 * gravity) * model.mass.transpose();
  for (int i = 0; i < model.network.X.cols(); ++i)
    if (model.network.X(0, i) < 0.06)
      forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  return forces;
}

/// Unknowns of nodes without a constraint.
inline Eigen::VectorXi free_unknowns(const MassSpringModel& model, const Forces& forces) {
  std::vector<int> constrained(model.network.X.cols(), 0), unknowns;
  for (const Constraint& c : forces.constraints) constrained[c.node] = 1;
  for (int i = 0; i < model.network.X.cols(); ++i)
    for (int c = 0; c < 3 && !constrained[i]; ++c) unknowns.push_back(3 * i + c);
  return Eigen::VectorXi::Map(unknowns.data(), static_cast<Eigen::Index>(unknowns.size()));
}

}  // namespace testbed::massspring
