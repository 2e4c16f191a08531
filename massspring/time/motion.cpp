#include "massspring/time/motion.h"

#include "meshing/surface/surface.h"
#include "meshing/surface_energies/barrier.h"
#include "meshing/surface_energies/self_contact.h"

namespace testbed::massspring {

Motion::Motion(const MassSpringModel& model, const Forces& forces, const Contacts& contacts)
    : model(model), forces(forces), contacts(contacts), constraints(forces.constraints) {
  if (contacts.self_thickness)
    surface_energies.push_back(std::make_unique<SurfaceContact>(model.network.X, model.network.F,
                                                                model.material.E, *contacts.self_thickness));
}

void Motion::add_barrier() {
  const Eigen::Matrix3Xd& X = model.network.X;
  const Eigen::Matrix2Xi E = model.springs ? model.springs->E : edges_of(model.network.F);
  double length = 0;
  for (const auto& edge : E.colwise()) length += (X.col(edge(0)) - X.col(edge(1))).norm() / E.cols();
  std::vector<char> is_held(X.cols(), false);
  for (const Constraint& c : forces.constraints) is_held[c.node] = true;
  std::vector<int> nodes;
  for (int i = 0; i < X.cols(); ++i)
    if (!is_held[i]) nodes.push_back(i);
  surface_energies.insert(surface_energies.begin(),
                          std::make_unique<Barrier>(X, nodes, model.material.E * length, contacts.bodies));
}

void Motion::forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces_at(state, f);
  add_spring_damping(state.x, state.v, f);
  if (forces.mass_damping > 0) add_momenta(model, -forces.mass_damping, state.v, f);
}

void Motion::undamped_forces_at(const State& state, Eigen::Matrix3Xd& f) const {
  undamped_forces(model, forces, state, f);
  if (friction.size() > 0) f += friction;
  for (const auto& energy : surface_energies) energy->add_forces(state.x, f);
}

void Motion::add_spring_damping(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                                Eigen::Matrix3Xd& f) const {
  if (model.springs && model.springs->damping > 0) add_damping_forces(*model.springs, damped_at(x), v, f);
}

double Motion::potential(const State& state) const {
  double sum = massspring::potential(model, forces, state);
  for (const auto& energy : surface_energies) sum += energy->energy(state.x);
  return sum;
}

void Motion::constrain(Eigen::Matrix3Xd& v) const {
  for (const Constraint& c : constraints) v.col(c.node) = c.S * v.col(c.node) + c.velocity;
}

}  // namespace testbed::massspring
