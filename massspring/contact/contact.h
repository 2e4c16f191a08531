// Contact of nodes with obstacles. Explicit schemes project, the linearised one constrains by the matrix W
// [paper 3.2], and those that minimise have a barrier [Li et al. 2020].
#pragma once

#include "massspring/contact/rigid_body.h"
#include "massspring/model/model.h"

namespace testbed::massspring {

/// What the surface must not enter.
struct Contacts {
  std::vector<RigidBody> bodies;
  std::optional<double> self_thickness;  ///< that the surface keeps from itself (m)
};

inline const Contacts kNoContacts;

/// @throws std::runtime_error when the mesh of an obstacle cannot be read or is not closed
Contacts contacts_of(const Scene& scene, const SurfaceMesh& surface);

/// Explicit schemes: nodes that end a step inside a body, or went through it, are set onto its surface.
/// They lose their velocity into it and, by Coulomb's friction, of that along it as much as the blow allows.
/// Takes energy only. The step leads from `before` to positions x and velocities v.
class PushOut {
 public:
  explicit PushOut(const std::vector<RigidBody>& bodies) : bodies_(bodies), clearance_(bodies.size()) {}

  /// To be called for every step in turn: nodes are not looked
  /// at while they have gone less far than a body was away.
  void operator()(const State& before, double h, Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& v);

 private:
  const std::vector<RigidBody>& bodies_;
  std::vector<Eigen::VectorXd> clearance_;  ///< per body and node, what it may go before it is looked at (m)
};

/// Linearised implicit scheme: nodes in touch move along their obstacle, or with it while friction holds
/// them, until the force that keeps them there would pull.
class Touches {
 public:
  /// Adds the constraints of the nodes in touch to `constraints`. Adds to `friction` (N, 3 x n)
  /// that of the nodes that slide, as known from the step before.
  void hold(const std::vector<RigidBody>& bodies, const State& state, double h,
            std::vector<Constraint>& constraints, Eigen::Matrix3Xd& friction) const;

  /// Looks at the forces r = M dv/h - f (N) that the constraints took in the
  /// step from `before`: lets nodes go where they pull, and slide or stick
  /// where friction gives or holds; then pushes out what else is inside.
  void settle(const std::vector<RigidBody>& bodies, const State& before, double h, const Eigen::Matrix3Xd& r,
              Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& v);

  bool empty() const { return touches_.empty(); }

 private:
  struct Touch {
    int node, body;
    bool is_stuck;
    Eigen::Vector3d friction;  ///< of the next step where it slides (N)
  };
  std::vector<Touch> touches_;  ///< ascending nodes, one each
};

/// Schemes that minimise: an energy that rises without bound towards the bodies' surfaces,
///   kappa sum_i b(d_i), b(d) = -(d - D)^2 ln(d/D) for d < D, else 0, [(26)]
/// d_i the gap of node i. Friction is the lagged potential of
/// a force smoothed below a speed that is no motion to the eye.
class Barrier {
 public:
  /// Nodes that supports hold are left alone. kappa = E times the mean length of springs or, without, of the
  /// surface's edges; D is a thousandth of the box's diagonal.
  Barrier(const MassSpringModel& model, const Forces& forces, const std::vector<RigidBody>& bodies);

  /// A step begins: bodies go to their places at t + h,
  /// friction is taken from the contact forces at x (3 x n, m).
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x);

  /// Moves y to where it is outside of all bodies, coming from x. Returns whether it had to.
  bool keep_out(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) const;

  /// Largest part of the step dx from x that stays outside, at most 1.
  double largest_step(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx) const;

  /// Newton's method went from x to y: friction forces as the last Hessian foresaw them, which the next one
  /// takes. That of friction at y itself knows nothing of what lies beyond the slip: iterates then leap to
  /// and fro across it [Chan, Golub & Mulet 1999].
  void follow(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y);

  /// Diagonal blocks += positive semidefinite part of the Hessian (N/m).
  void add_hessian(const Eigen::Matrix3Xd& x, std::vector<Eigen::Matrix3d>& diagonal) const;
  double energy(const Eigen::Matrix3Xd& x) const;                         ///< J; infinite inside
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const;  ///< N

 private:
  struct Held {
    int node;
    Eigen::Vector3d normal, start;  ///< start: of the node, moving with the body (m)
    double limit;                   ///< friction coefficient times contact force (N)
    Eigen::Vector3d friction;       ///< that the node exerts, as foreseen (N)
  };
  Eigen::Vector3d slid(const Held& held, const Eigen::Matrix3Xd& x) const;
  template <class Visit>
  void for_each_near(const Eigen::Matrix3Xd& x, const Visit& visit) const;

  const std::vector<RigidBody>& bodies_;
  std::vector<int> nodes_;  ///< that are free
  double kappa_, range_;    ///< N/m, m
  double t_before_ = 0, t_ = 0;
  double slip_ = 0;  ///< below which friction is smoothed (m)
  std::vector<Held> held_;
};

}  // namespace testbed::massspring
