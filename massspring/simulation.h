// A scene's body under growing load or in time: the order of a step. Knows no files and no command line.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "massspring/statics/quasi_static.h"
#include "massspring/time/integrators.h"
#include "meshing/base/snapshot.h"

namespace testbed::massspring {

struct SimulationReport {
  Status status = Status::Ok;
  std::string reason;  ///< why it ended early
  int n_steps = 0;
  int n_at_rest = 0, n_halved = 0;  ///< of the steps done
  int n_unsolved = 0;               ///< steps in a row, to the last, that did not converge
  int newton_iterations = 0, linear_iterations = 0;
  double residual = 0;              ///< of the last step
  std::optional<double> tolerance;  ///< of the residual or, of schemes that minimise, of a step over the body
  std::string solver;               ///< of linear systems, and why; empty where there are none
  std::string full_geometry;        ///< why, although strain is small; else empty
};

/// How steps so far went.
inline void archive(meshing::Archive& a, SimulationReport& r) {
  a(r.status, r.n_at_rest, r.n_halved, r.n_unsolved, r.newton_iterations, r.linear_iterations);
}

class Simulation {
 public:
  /// The body at rest, on a network with links and tetrahedra where the scene's calibration needs them.
  /// @throws std::runtime_error when parts of the scene do not go together
  Simulation(const Scene& scene, const SpringNetwork& network);
  Simulation(const Simulation&) = delete;

  /// Takes the next load step or time step. Returns how it ended; there is a state to show for it in any case.
  Status advance();
  /// All steps are done, or one found no state to go on from, as do three in a row of a motion that do not converge.
  bool has_ended() const;

  const MassSpringModel& model() const { return model_; }
  const Forces& forces() const { return forces_; }
  /// All that decides how the run goes on. What is kept from step to step besides changes a step within its
  /// tolerance: preconditioners, factors of matrices that change, and first guesses. Explicit steps and those of
  /// a linear model have none of these.
  const State& state() const { return state_; }
  /// Goes on from a state of a simulation of the same scene and network, and forgets what is kept besides.
  /// @throws std::runtime_error for another number of nodes
  void set_state(const State& state);
  /// Statics: the next step starts at these displacements (3 x n, m), as if they were the equilibrium under full load.
  void start_at(const Eigen::Matrix3Xd& u) { equilibrium_->start_at(u, state_); }
  /// Statics: of a network split in eight, after which `coarser` is not stepped: see QuasiStaticSolver::set_coarser.
  void set_coarser(const Eigen::Matrix2Xi& between, const Simulation& coarser) {
    equilibrium_->set_coarser(between, *coarser.equilibrium_);
  }
  /// A motion's state, counts and what is kept from step to step, as bytes; of statics none.
  std::string saved() const;
  /// Goes on bit for bit from what a simulation of the same scene and network has saved.
  /// @throws std::runtime_error where it is cut
  void restore(const std::string& saved);
  /// Goes on from the state at hand under a scene with other values: those of material.E and nu, gravity, the
  /// loads' pressure, collapse, obstacles, handles, time.integrator and time.step. The scene's own events do the same.
  /// @throws std::runtime_error as meshing::changed_keys
  void change(const Scene& scene);
  const SimulationReport& report() const { return report_; }
  Status status() const { return report_.status; }
  int n_done() const { return state_.n_done; }
  int n_steps() const { return report_.n_steps; }
  /// In [0, 1]: linear equilibria are in proportion to the first.
  double progress() const {
    const bool is_known = is_static() && model_.linear && n_done() > 0;
    return is_known ? 1 : static_cast<double>(n_done()) / n_steps();
  }
  Snapshot snapshot() const;
  bool is_static() const { return equilibrium_ != nullptr; }
  /// Of the loads that act on the state: 1 in time.
  double load_factor() const { return is_static() ? state_.t : 1; }
  double step() const { return step_; }                                        ///< of time (s); 0 in statics
  const QuasiStaticSolver* equilibrium() const { return equilibrium_.get(); }  ///< of statics

 private:
  void turn_to(const Scene& scene);
  void obey_events();
  void push_out_of_obstacles();
  void make_model();
  void find_collapsing();
  void act_on_model();
  void begin_stepping();
  void count_steps();
  void set_target_volume(double t);
  StepReport take_step();
  void check_energy();
  void check_strain();
  bool is_check_due() const;
  void release_nodes();

  const Scene first_;
  Scene scene_;  ///< as events have left it
  SpringNetwork network_;
  SurfaceProblem problem_;
  MassSpringModel model_;
  Forces forces_;
  Contacts contacts_;
  State state_;
  double step_ = 0;
  SimulationReport report_;
  std::unique_ptr<QuasiStaticSolver> equilibrium_;
  IntegratorOptions options_;
  std::unique_ptr<TimeStepper> stepper_;
  std::ptrdiff_t n_holding_;  ///< supports that hold nodes in the step at hand
};

}  // namespace testbed::massspring
