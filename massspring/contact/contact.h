// Contact with obstacles. Explicit schemes project nodes, the linearised one constrains them by the matrix W
// [paper 3.2], and what minimises has a barrier on the surface [Li et al. 2020].
#pragma once

#include "massspring/model/model.h"
#include "meshing/surface_energies/rigid_body.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::massspring {

/// What the surface must not enter.
struct Contacts {
  std::vector<RigidBody> bodies;
  std::optional<double> self_thickness;  ///< that the surface keeps from itself (m)
  double self_friction = 0;              ///< Coulomb's coefficient, of the barrier
};

inline const Contacts kNoContacts;

/// @throws std::runtime_error when the mesh of an obstacle cannot be read or is not closed
Contacts contacts_of(const Scene& scene, const SurfaceMesh& surface);

/// The barriers of obstacles and of a model's surface itself, for schemes that minimise.
SurfaceEnergies barriers_of(const Contacts& contacts, const MassSpringModel& model,
                            const std::vector<Constraint>& constraints);

/// As of meshing, of the model at rest.
void check_apart(const Contacts& contacts, const MassSpringModel& model,
                 const std::vector<Constraint>& constraints);

/// Adds obstacles as statics have them to what acts on a model's surface.
void add_obstacles(const Contacts& contacts, const MassSpringModel& model, Forces& forces);

/// Explicit schemes: nodes that end a step inside a body, or went through it, are set onto its surface.
/// They lose their velocity into it and, by Coulomb's friction, of that along it as much as the blow allows.
/// Takes energy only. The step leads from `before` to positions x and velocities v.
/// @param clearance  of `before`, then of x: nodes are not looked at while they have gone less far than a body
/// was away
/// @param mass  kg per node
/// Returns whether it set any.
/// @param flows  to which work of moving bodies, and what their friction takes, are added
bool push_out(const std::vector<RigidBody>& bodies, const State& before, double h,
              const Eigen::VectorXd& mass, std::vector<Eigen::VectorXd>& clearance, Eigen::Matrix3Xd& x,
              Eigen::Matrix3Xd& v, meshing::EnergyFlows& flows);

/// Friction of nodes that slide, the same within a step.
struct SlidingFriction : SurfaceEnergy {
  Eigen::Matrix3Xd force;  ///< N, 3 x n
  Eigen::Matrix3Xd start;  ///< of the nodes, moving with what they slide on (m)
  double driven = 0;       ///< work of what moves (J)

  const char* name() const override { return "friction"; }
  double energy(const Eigen::Matrix3Xd& x) const override { return -force.cwiseProduct(x - start).sum(); }
  double stored(const Eigen::Matrix3Xd&) const override { return 0; }
  double friction(const Eigen::Matrix3Xd& x) const override { return energy(x); }
  double work(const Eigen::Matrix3Xd&) const override { return driven; }
  bool is_stiff() const override { return true; }
  void add_forces(const Eigen::Matrix3Xd&, Eigen::Matrix3Xd& f) const override { f += force; }
  void add_hessian(const Eigen::Matrix3Xd&, SurfaceHessian&, Curvature) const override {}
  bool is_invariant() const override { return false; }
};

/// The active set of the linearised implicit scheme: nodes in touch move along their obstacle, or with it while
/// friction holds them, until the force that keeps them there would pull. Adds their constraints to `constraints`, and to
/// `friction` that of the nodes that slide, as known from the step before.
void constrain_active(const std::vector<RigidBody>& bodies, const State& state, double h,
                      std::vector<Constraint>& constraints, SlidingFriction& friction);

/// Looks at the forces r = M dv/h - f (N) that the constraints took in the step from `before`: lets nodes go
/// where they pull, and slide or stick where friction gives or holds; then pushes out what else is inside.
/// Returns the nodes in touch at the end. Adds to `flows` as push_out.
std::vector<Touch> settle_active(const std::vector<RigidBody>& bodies, const State& before, double h,
                                 const Eigen::VectorXd& mass, const Eigen::Matrix3Xd& r, Eigen::Matrix3Xd& x,
                                 Eigen::Matrix3Xd& v, meshing::EnergyFlows& flows);

}  // namespace testbed::massspring
