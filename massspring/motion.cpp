#include "massspring/motion.h"

#include "massspring/volume_force.h"

namespace testbed {

Motion::Motion(const MassSpringModel& model, const Forces& forces, double end)
    : model(model), forces(forces), end(end) {}

void Motion::undamped_forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  f = forces.load;
  if (model.springs) add_forces(*model.springs, state.rest_length, state.x, f);
  if (model.tet_springs) add_forces(*model.tet_springs, state.x, f);
  if (forces.volume_pressure)
    add_volume_forces(*forces.volume_pressure, state.target_volume, model.network.F, state.x, f);
}

void Motion::forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces_at(state, f);
  if (model.springs && model.springs->damping > 0) add_damping_forces(*model.springs, state.x, state.v, f);
  if (forces.mass_damping > 0) f -= state.v * (forces.mass_damping * model.mass).asDiagonal();
}

double Motion::potential(const State& state) const {
  double sum = elastic_energy(model, state) - forces.load.cwiseProduct(state.x - model.network.X).sum();
  if (forces.volume_pressure)
    sum += volume_energy(*forces.volume_pressure, state.target_volume, model.network.F, state.x);
  return sum;
}

void Motion::constrain(Eigen::Matrix3Xd& v) const {
  for (const Constraint& c : forces.constraints)
    v.col(c.node) = c.S * v.col(c.node) + (Eigen::Matrix3d::Identity() - c.S) * c.displacement / end;
}

}  // namespace testbed
