// Steps in time at small and finite strain, on assembled matrices.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "fem_reference/solid/elasticity.h"
#include "meshing/algebra/cholesky.h"
#include "meshing/surface_energies/energy_ledger.h"

namespace testbed::fem {

/// Parameters of the generalised-alpha method [Chung & Hulbert 1993].
struct TimeScheme {
  double alpha_m, alpha_f, beta, gamma;
  double early = 0.5 - beta;  ///< part of the acceleration before, as beta is that of the one after
};
/// Average acceleration [Newmark 1959]: conserves energy of undamped motion exactly.
constexpr TimeScheme kNewmark{0, 0, 0.25, 0.5};
/// u_1 = u_0 + h v_1, v_1 = v_0 + h a_1. First order, never gains energy.
constexpr TimeScheme kImplicitEuler{0, 0, 1, 1, 0};
/// Second order; `rho`, in [0, 1], is what is left per step of the highest frequencies.
constexpr TimeScheme generalised_alpha(double rho) {
  const double alpha_m = (2 * rho - 1) / (rho + 1), alpha_f = rho / (rho + 1), d = 1 - alpha_m + alpha_f;
  return {alpha_m, alpha_f, d * d / 4, 0.5 - alpha_m + alpha_f};
}

/// M a + damping M v + stiffness_damping K v + f(u) = load. Of several processes each has its share of the unknowns: M, K,
/// load and f are 0 where others own.
struct Dynamics {
  Eigen::SparseMatrix<double> K, M;  ///< at rest (N/m); kg
  double damping = 0;                ///< 1/s
  double stiffness_damping = 0;      ///< s
  Eigen::VectorXd load;              ///< N, constant in time
  std::vector<int> constrained;      ///< unknowns whose motion is prescribed
  /// Their displacement at a time (m), which gives velocity and
  /// acceleration by central differences over a step; empty: they stay.
  std::function<Eigen::VectorXd(double t)> constrained_motion;
  /// f and its tangent (if asked for) at finite strain; empty: K u.
  std::function<Linearisation(const Eigen::VectorXd& u, bool with_tangent)> linearise;
  /// The same f alone, not finite where its energy is not; empty: from the others.
  std::function<void(const Eigen::VectorXd& u, Eigen::Matrix3Xd& force)> forces = {};
  double tolerance = 1e-10;  ///< at finite strain: forces out of balance over load, inertia and f
  /// Of f at finite strain (J), infinite where there is none; empty: the elastic energy of `linearise`.
  std::function<double(const Eigen::VectorXd& u)> potential = {};
  Eigen::Matrix3Xd X = {};                ///< nodes at rest, where there is `linearise` (m)
  meshing::SurfaceEnergies surface = {};  ///< what of f acts on it, of positions X + u
  /// Brings unknowns that others own up to date; empty: there are none.
  std::function<void(Eigen::VectorXd& u)> exchange = {};
  /// Of several processes: solves `mass` M + `stiffness` K(u), nothing constrained but these unknowns.
  std::function<StepSolver(const Eigen::SparseMatrix<double>& M, double mass, const Eigen::VectorXd& u,
                           double stiffness, const std::vector<int>& constrained)>
      step_solver = {};
  Eigen::MatrixXd roots = {};  ///< of what K leaves out at rest, roots roots^T: enclosed volumes
};

/// Stiffness and mass of a solid, which outlives it, and what several processes need besides.
Dynamics dynamics_of(const ElasticSolid& solid, MassMatrix mass);

/// All that decides how a motion goes on.
struct MotionState {
  int n_steps = 0;          ///< taken
  double begun = 0;         ///< before the first of them (s)
  Eigen::VectorXd u, v, a;  ///< m, m/s, m/s2
  Eigen::VectorXd force;    ///< f(u) as the last step found it (N); empty where no scheme asks for it
  meshing::SurfaceMemories surface;  ///< of what acts on it
  meshing::EnergyLedger ledger;
};

inline void archive(meshing::Archive& a, MotionState& state) {
  a(state.n_steps, state.begun, state.u, state.v, state.a, state.force, state.surface, state.ledger);
}

/// What the steps of a motion took.
struct StepCounts {
  int newton_iterations = 0, factorisations = 0;
  int halved = 0;  ///< steps that shorter ones took the place of, as Newton's method did not end
};

inline void archive(meshing::Archive& a, StepCounts& counts) {
  a(counts.newton_iterations, counts.factorisations, counts.halved);
}

/// A body in motion by steps of h, from rest.
class Integrator {
 public:
  virtual ~Integrator() = default;

  /// Takes a step, whose flows of energy go into the ledger. Whether it found a state; else the motion has ended.
  bool advance();
  /// The step itself.
  virtual bool step() = 0;
  /// Changes what the body is free of stress at, between steps; the elastic energy that this gives is put in.
  void change_rest(const std::function<void()>& change);
  /// Takes the balance of energy.
  void settle() { ledger_.settle(kinetic_energy(), elastic_energy()); }
  const meshing::EnergyLedger& ledger() const { return ledger_; }
  const meshing::SurfaceEnergies& surface() const { return system_.surface; }
  /// The scheme, and how its equations are solved.
  virtual std::string solver() const = 0;
  /// Starts again from a displacement and a velocity, with the acceleration that belongs to them.
  void restart(const Eigen::VectorXd& u, const Eigen::VectorXd& v) {
    n_steps_ = 0;
    go_on(u, v);
    begin_ledger();
  }
  /// Goes on from where a motion of the same body under other values has come to, in steps of its own length, with
  /// the acceleration that belongs to displacement and velocity here.
  void take_over(const Integrator& before);
  /// Goes on from here with other unknowns constrained, and their motion as in Dynamics.
  void hold(const std::vector<int>& constrained, std::function<Eigen::VectorXd(double t)> motion);
  /// What is kept from step to step besides, as factors of tangents are, changes a step within its tolerance.
  /// Steps of linear forces and explicit ones have none of it.
  MotionState state() const {
    return {n_steps_, begun_, u_, v_, a_, f_, memories_of(system_.surface), ledger_};
  }
  /// Goes on from a state with what is constrained now, and forgets what is kept besides.
  void set_state(const MotionState& state);
  double t() const { return n_steps_ * step_ + begun_; }  ///< s
  const Eigen::VectorXd& u() const { return u_; }         ///< m
  const Eigen::VectorXd& v() const { return v_; }         ///< m/s
  double kinetic_energy() const;                          ///< J, as the next of all processes
  double elastic_energy() const;
  const StepCounts& counts() const { return counts_; }
  void set_counts(const StepCounts& counts) { counts_ = counts; }

 protected:
  Integrator(Dynamics system, double h) : system_(std::move(system)), step_(h), h_(h) {}
  struct ConstrainedState {
    Eigen::VectorXd u, v, a;
  };
  ConstrainedState constrained_at(double t) const;
  /// Takes over where a motion starts, but for what is constrained, whose state it returns.
  ConstrainedState start_at(const Eigen::VectorXd& u, const Eigen::VectorXd& v);
  Linearisation respond(const Eigen::VectorXd& u, bool with_tangent) const;
  /// f(u), not finite where the energy is not.
  Eigen::VectorXd force_of(const Eigen::VectorXd& u) const;
  double potential_of(const Eigen::VectorXd& u) const;  // of all processes
  /// Nodes where the surface's energies see them.
  Eigen::Matrix3Xd at(const Eigen::VectorXd& u) const { return system_.X + u.reshaped(3, system_.X.cols()); }
  void begin_ledger();
  double damping_power(const Eigen::VectorXd& v) const;
  double work_of_supports(const Eigen::VectorXd& u, const Eigen::VectorXd& v) const;
  /// A step begins for what acts on the surface.
  void begin_step();
  /// Takes over what is constrained.
  virtual void find_free() = 0;
  /// From a displacement and a velocity at t().
  virtual void go_on(const Eigen::VectorXd& u, const Eigen::VectorXd& v) = 0;

  Dynamics system_;
  const double step_;     // s
  double h_, begun_ = 0;  // of the part of a step at hand; before the first step, and this part in its (s)
  Eigen::VectorXd u_, v_, a_, f_;  // f_: f(u_), where a scheme keeps it
  int n_steps_ = 0;
  StepCounts counts_;
  meshing::EnergyLedger ledger_;
};

/// The generalised-alpha method. Each step is solved by sparse Cholesky: with one factor where f is linear, else
/// by Newton's method with a line search on the incremental potential, whose gradient is the step's equation, and
/// a factor in single precision, renewed where iterations converge slowly. Several processes iterate as in statics
/// instead. A step in which it does not end is taken in halves, down to a 64th.
class GeneralisedAlpha : public Integrator {
 public:
  GeneralisedAlpha(Dynamics system, double h, const TimeScheme& scheme);

  bool step() override;
  std::string solver() const override;

 private:
  bool advance_whole();
  bool advance_or_halves(int n_halvings);
  void set_length(double h);
  void find_free() override;
  void go_on(const Eigen::VectorXd& u, const Eigen::VectorXd& v) override;
  struct Trial;
  bool factorise(const Eigen::SparseMatrix<double>& tangent);
  bool factorise_at(const Eigen::VectorXd& u);
  bool find_linear_acceleration(const ConstrainedState& constrained, Trial& trial) const;
  std::pair<double, double> weights() const;
  std::optional<Eigen::Matrix3Xd> direction(const Eigen::Matrix3Xd& r) const;
  void follow(const ConstrainedState& constrained, Trial& trial) const;
  Eigen::VectorXd momentum_change(const Trial& trial) const;
  double incremental_potential(const Trial& trial) const;
  bool find_acceleration(const ConstrainedState& constrained, Trial& trial);

  TimeScheme scheme_;
  std::vector<int> free_;
  std::optional<meshing::SparseCholesky> factor_;
  StepSolver solver_;  // of several processes, in the factor's place
  // At finite strain:
  double energy_scale_ = 0;  // of what a body as large as itself would take: for rounding (J)
  double least_size_ = 0;    // of forces that a step is held against (N)
  meshing::SinglePrecisionFactor single_;
  Eigen::MatrixXd roots_, solved_roots_;  // G, and what the factor makes of it, of a tangent with G G^T
};

}  // namespace testbed::fem
