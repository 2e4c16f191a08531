#include "massspring/time/motion.h"

namespace testbed::massspring {

Motion::Motion(const MassSpringModel& model, const Forces& forces, const Contacts& contacts)
    : model(model), forces(forces), contacts(contacts), constraints(forces.constraints) {
  if (contacts.self_thickness) self_contact.emplace(model, *contacts.self_thickness);
}

void Motion::forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces_at(state, f);
  add_spring_damping(state.x, state.v, f);
  if (forces.mass_damping > 0) add_momenta(model, -forces.mass_damping, state.v, f);
}

void Motion::undamped_forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces(model, forces, state, f);
  if (friction.size() > 0) f += friction;
  if (barrier) barrier->add_forces(state.x, f);
  if (self_contact) self_contact->add_forces(state.x, f);
}

void Motion::add_spring_damping(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                                Eigen::Matrix3Xd& f) const {
  if (model.springs && model.springs->damping > 0) add_damping_forces(*model.springs, damped_at(x), v, f);
}

double Motion::potential(const State& state) const {
  double sum = massspring::potential(model, forces, state);
  if (barrier) sum += barrier->energy(state.x);
  if (self_contact) sum += self_contact->energy(state.x);
  return sum;
}

void Motion::constrain(Eigen::Matrix3Xd& v) const {
  for (const Constraint& c : constraints) v.col(c.node) = c.S * v.col(c.node) + c.velocity;
}

}  // namespace testbed::massspring
