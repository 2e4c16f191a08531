#include "massspring/time/motion.h"

#include "meshing/surface_energies/self_contact.h"

namespace testbed::massspring {

Motion::Motion(const MassSpringModel& model, const Forces& forces, const Contacts& contacts)
    : model(model), forces(forces), contacts(contacts), constraints(forces.constraints) {
  if (contacts.self_thickness)
    touching.push_back(std::make_shared<SurfaceContact>(model.network.X, model.network.F, model.material.E,
                                                        *contacts.self_thickness));
}

void Motion::add_barrier() {
  touching.insert(touching.begin(), barrier_around(contacts, model, forces.constraints));
}

void Motion::add_friction() {
  friction = std::make_shared<SlidingFriction>();
  friction->force.setZero(3, model.network.X.cols());
  touching.insert(touching.begin(), friction);
}

void Motion::forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces_at(state, f);
  add_spring_damping(state.x, state.v, f);
  if (forces.mass_damping > 0) add_momenta(model, -forces.mass_damping, state.v, f);
}

void Motion::undamped_forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces(model, forces, state, f);
  for (const auto& energy : touching) energy->add_forces(state.x, f);
}

void Motion::add_spring_damping(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                                Eigen::Matrix3Xd& f) const {
  if (model.springs && model.springs->damping > 0) add_damping_forces(*model.springs, damped_at(x), v, f);
}

double Motion::potential(const State& state) const {
  double sum = massspring::potential(model, forces, state);
  for (const auto& energy : touching) sum += energy->energy(state.x);
  return sum;
}

SurfaceEnergies Motion::surface() const {
  SurfaceEnergies all = forces.surface;
  all.insert(all.end(), touching.begin(), touching.end());
  return all;
}

SurfaceHessian Motion::surface_hessian(const State& state, Curvature curvature) const {
  SurfaceHessian H = massspring::surface_hessian(forces, state, curvature);
  for (const auto& energy : touching) energy->add_hessian(state.x, H, curvature);
  return H;
}

void Motion::constrain(Eigen::Matrix3Xd& v) const {
  for (const Constraint& c : constraints) v.col(c.node) = c.S * v.col(c.node) + c.velocity;
}

}  // namespace testbed::massspring
