// The equation of motion that every integrator steps: M dv/dt = f(x, v), dx/dt = v.
#pragma once

#include "massspring/contact/contact.h"

namespace testbed::massspring {

struct EquationOfMotion {
  EquationOfMotion(const MassSpringModel& model, const Forces& forces,
                   const Contacts& contacts = kNoContacts);

  /// Contacts are barriers from here on, for schemes that minimise.
  void add_barriers();
  /// Lets nodes slide along obstacles, for the scheme that constrains them.
  void add_friction();

  /// f(x, v) (N), the list of all that acts on the model.
  void forces_at(const State& state, Eigen::Matrix3Xd& f) const;

  /// The same without damping, the negative gradient of potential.
  void undamped_forces_at(const State& state, Eigen::Matrix3Xd& f) const;

  /// Where the directions come from in which independent springs at x damp: rest, of a linear model.
  const Eigen::Matrix3Xd& damped_at(const Eigen::Matrix3Xd& x) const {
    return model.linear ? model.network.X : x;  // NOLINT(bugprone-return-const-ref-from-parameter)
  }

  /// Adds the damping of independent springs (N).
  void add_spring_damping(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v, Eigen::Matrix3Xd& f) const;

  /// Energy (J): elastic, of volume, loads and contacts.
  double potential(const State& state) const;

  /// All that acts on the surface: of `forces`, then of contacts.
  SurfaceEnergies surface() const;

  /// Its Hessian (N/m).
  SurfaceHessian surface_hessian(const State& state, Curvature curvature) const;

  /// v_i <- S_i v_i + what is prescribed along the directions taken away [paper 3.2].
  void constrain(Eigen::Matrix3Xd& v) const;

  const MassSpringModel& model;
  const Forces& forces;
  const Contacts& contacts;
  std::vector<Constraint> constraints;        ///< in this step: supports, and contacts that hold nodes
  std::shared_ptr<SlidingFriction> friction;  ///< of contacts that nodes slide along in this step
  SurfaceEnergies touching;                   ///< of contacts
};

}  // namespace testbed::massspring
