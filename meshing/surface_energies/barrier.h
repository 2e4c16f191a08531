// Obstacles as a barrier around them, with friction [Li et al. 2020].
#pragma once

#include "meshing/surface_energies/rigid_body.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// An energy that rises without bound towards the bodies' surfaces,
///   kappa sum_i b(d_i), b(d) = -(d - D)^2 ln(d/D) for d < D, else 0, [(26)]
/// d_i the gap of node i. Friction is the lagged potential of
/// a force smoothed below a speed that is no motion to the eye.
class Barrier : public SurfaceEnergy {
 public:
  /// D is a thousandth of the diagonal of the box of X (3 x n, m).
  /// @param nodes  that it acts on
  /// @param kappa  N/m
  /// @param bodies  outlive it
  Barrier(const Eigen::Matrix3Xd& X, std::vector<int> nodes, double kappa,
          const std::vector<RigidBody>& bodies);

  double energy(const Eigen::Matrix3Xd& x) const override;  ///< J; infinite inside
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;
  /// Bodies go to their places at t + h, friction is taken from the contact forces at x.
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  bool keep_out(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) const override;
  double largest_step(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx) const override;
  /// Takes friction forces as the last Hessian foresaw them, for the next one. That of friction at y itself
  /// knows nothing of what lies beyond the slip: iterates then leap to and fro across it
  /// [Chan, Golub & Mulet 1999].
  void follow(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) override;
  bool bounds_steps() const override { return true; }
  bool is_stiff() const override { return true; }
  bool is_invariant() const override { return false; }

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
  std::vector<int> nodes_;  ///< that it acts on
  double kappa_, range_;    ///< N/m, m
  double t_before_ = 0, t_ = 0;
  double slip_ = 0;  ///< below which friction is smoothed (m)
  std::vector<Held> held_;
};

}  // namespace testbed::meshing
