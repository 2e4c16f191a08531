#include "massspring/time/equation_of_motion.h"

#include "meshing/surface_energies/self_contact.h"

namespace testbed::massspring {

EquationOfMotion::EquationOfMotion(const MassSpringModel& model, const Forces& forces,
                                   const Contacts& contacts)
    : model(model), forces(forces), contacts(contacts), constraints(forces.constraints) {
  if (contacts.self_thickness)
    touching.push_back(std::make_shared<SurfaceContact>(model.network.X, model.network.F, model.material.E,
                                                        *contacts.self_thickness));
}

void EquationOfMotion::add_barriers() {
  touching = barriers_of(contacts, model, forces.constraints);
}

void EquationOfMotion::add_friction() {
  friction = std::make_shared<SlidingFriction>();
  friction->force.setZero(3, model.network.X.cols());
  touching.insert(touching.begin(), friction);
}

void EquationOfMotion::forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces_at(state, f);
  add_spring_damping(state.x, state.v, f);
  if (forces.mass_damping > 0) add_momenta(model, -forces.mass_damping, state.v, f);
}

void EquationOfMotion::undamped_forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces(model, forces, state, f);
  for (const auto& energy : touching) energy->add_forces(state.x, f);
}

void EquationOfMotion::add_spring_damping(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                                          Eigen::Matrix3Xd& f) const {
  if (model.springs && model.springs->damping > 0) add_damping_forces(*model.springs, damped_at(x), v, f);
}

double EquationOfMotion::potential(const State& state) const {
  double sum = massspring::potential(model, forces, state);
  for (const auto& energy : touching) sum += energy->energy(state.x);
  return sum;
}

SurfaceEnergies EquationOfMotion::surface() const {
  SurfaceEnergies all = forces.surface;
  all.insert(all.end(), touching.begin(), touching.end());
  return all;
}

SurfaceHessian EquationOfMotion::surface_hessian(const State& state, Curvature curvature) const {
  SurfaceHessian H = massspring::surface_hessian(forces, state, curvature);
  for (const auto& energy : touching) energy->add_hessian(state.x, H, curvature);
  return H;
}

void EquationOfMotion::constrain(Eigen::Matrix3Xd& v) const {
  for (const Constraint& c : constraints) v.col(c.node) = c.S * v.col(c.node) + c.velocity;
}

}  // namespace testbed::massspring
