// Obstacles as a barrier around them, with friction [Li et al. 2020].
#pragma once

#include "meshing/surface_energies/rigid_body.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// When friction takes over contact forces and the directions in which bodies press.
enum class FrictionLag {
  Step,      ///< as a step begins, so that it has a potential
  Iteration  ///< after each iteration of Newton's method, so that its end is Coulomb's law: statics
};

/// An energy of points of a surface that rises without bound towards the bodies,
///   kappa sum_q w_q b(d_q), b(d) = -(d - D)^2 ln(d/D) for d < D, else 0, [(26)]
/// d_q the gap of point q and w_q its share of the surface at rest. Friction is the lagged potential of
/// a force smoothed below a speed that is no motion to the eye.
class Barrier : public SurfaceEnergy {
 public:
  /// @param weights  of the points (m2)
  /// @param range  D (m) of bodies that have none of their own
  /// @param kappa  there (Pa/m); it goes with 1/D
  Barrier(const Eigen::VectorXd& weights, double range, double kappa, std::vector<RigidBody> bodies,
          FrictionLag lag = FrictionLag::Step)
      : bodies_(std::move(bodies)),
        weights_(weights.replicate(1, static_cast<Eigen::Index>(bodies_.size()))),
        range_(range),
        kappa_(kappa),
        lag_(lag) {}

  const std::vector<RigidBody>& bodies() const { return bodies_; }
  /// @param weights  of each point towards each body from here on (m2)
  void set_weights(Eigen::MatrixXd weights) { weights_ = std::move(weights); }

  const char* name() const override { return "barrier"; }
  double energy(const Eigen::Matrix3Xd& x) const override;  ///< J; infinite inside
  double stored(const Eigen::Matrix3Xd& x) const override;
  double friction(const Eigen::Matrix3Xd& x) const override;
  double work(const Eigen::Matrix3Xd& x) const override;
  std::vector<Contact> contacts(const Eigen::Matrix3Xd& x) const override;
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
    size_t body;
    int point;
    Eigen::Vector3d normal, start;  ///< start: of the point, moving with the body (m)
    double limit;                   ///< friction coefficient times contact force (N)
    Eigen::Vector3d friction;       ///< that the point exerts, as foreseen (N)
  };
  double range(size_t body) const { return bodies_[body].range.value_or(range_); }
  double stiffness(int point, size_t body) const {
    return kappa_ * range_ / range(body) * weights_(point, static_cast<Eigen::Index>(body));
  }
  double slip(const Held& held) const { return slip_ * range(held.body); }
  Eigen::Vector3d slid(const Held& held, const Eigen::Matrix3Xd& x) const;
  Eigen::Vector3d friction_on(const Held& held, const Eigen::Matrix3Xd& x) const;
  Eigen::Vector3d pressing_on(int point, size_t body, const RigidBody::Gap& gap) const;
  void find_friction(const Eigen::Matrix3Xd& x, double t);
  template <class Visit>
  void for_each_near(const Eigen::Matrix3Xd& x, const Visit& visit) const;

  std::vector<RigidBody> bodies_;
  Eigen::MatrixXd weights_;  ///< of points and bodies (m2)
  double range_, kappa_;     ///< m, Pa/m
  FrictionLag lag_;
  double t_before_ = 0, t_ = 0;
  Eigen::Matrix3Xd start_;  ///< points at t_before_ (m)
  double slip_ = 0;         ///< below which friction is smoothed, over the range
  std::vector<Held> held_;
};

/// The barrier of a scene on the points contact_points of a body's faces. Its range and kappa are those of the
/// body at rest, however fine its mesh is: D a thousandth of the diagonal of its box and kappa = E/(50 D), so
/// that a pressure of 0.024 E halves the gap at which bodies begin to touch. A face counts by the cosine
/// between its normal, as a step begins, and the way to a body: at the edge of what is pressed its neighbours do
/// not count twice.
/// @param X  nodes at rest (3 x n, m)
/// @param faces  3 or 6 nodes each
/// @param E  Young's modulus (Pa)
/// @param is_constrained  per node, whether nothing moves it but its supports
/// @param size  diagonal of the body's box (m); absent: that of X
/// @param is_counted  of points; absent: all are
std::shared_ptr<SurfaceEnergy> barrier_around(const std::vector<RigidBody>& bodies, const Eigen::Matrix3Xd& X,
                                              const Eigen::MatrixXi& faces, double E,
                                              const std::vector<char>& is_constrained,
                                              FrictionLag lag = FrictionLag::Step,
                                              std::optional<double> size = {},
                                              const IsCounted& is_counted = {});

/// What obstacles are in statics: the barrier, with friction that ends as Coulomb's law, and a ProximalTerm where
/// constrained nodes do not hold the body.
SurfaceEnergies obstacles_in_statics(const std::vector<RigidBody>& bodies, const Eigen::Matrix3Xd& X,
                                     const Eigen::MatrixXi& faces, double E,
                                     const std::vector<char>& is_constrained);

}  // namespace testbed::meshing
