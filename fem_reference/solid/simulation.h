// A scene's solid under growing load or in time. Knows no files and no command line.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fem_reference/solid/dynamics.h"
#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solid/schemes.h"
#include "meshing/algebra/status.h"
#include "meshing/base/snapshot.h"
#include "meshing/scene/scene.h"

namespace testbed::fem {

/// All that decides how a run goes on.
struct State {
  int n_done = 0;  ///< load or time steps that converged
  MotionState motion;
  std::optional<ElasticState> statics;  ///< absent: in motion
  Eigen::VectorXd length;  ///< in motion: over the first, at vertices of the mesh; empty: nothing collapses
  ElasticReport equilibrium;
};

class Simulation {
 public:
  /// @param timer  told what of the steps is assembly
  Simulation(const Scene& scene, const SurfaceMesh& surface, const TetMesh& mesh, StageTimer& timer);

  Simulation(const Simulation&) = delete;

  /// Takes the next load step or time step. Returns how it ended: with a state to show, or the run with it.
  Status advance();
  bool has_ended() const { return n_done_ == n_steps_ || status_ != Status::Ok; }
  Status status() const { return status_; }  ///< of the last step
  /// Why it ended early; empty where the status says all.
  const std::string& reason() const { return reason_; }
  State state() const;
  /// Goes on from a state of a simulation of the same scene and mesh, or of one under which it could go on.
  void set_state(const State& state);
  /// A motion's state and counts as bytes; of statics and of several processes none.
  std::string saved() const;
  /// Goes on from what a simulation of the same scene and mesh has saved.
  /// @throws std::runtime_error where it is cut
  void restore(const std::string& saved);
  /// Goes on from the state at hand under a scene with other values: those of material.E and nu, gravity, the
  /// loads' pressure, collapse, obstacles, reference.integrator and spectral_radius, and time.step. The balance of
  /// energy begins anew, but where collapse alone changes and no volume is kept.
  /// @throws std::runtime_error as meshing::changed_keys, and for what the reference does not model; nothing has
  /// changed then
  void change(const Scene& scene);
  int n_done() const { return n_done_; }  ///< that converged
  int n_steps() const { return n_steps_; }
  /// In [0, 1]: linear equilibria are in proportion to the first.
  double progress() const { return is_solved_ ? 1 : load_factor(); }
  Snapshot snapshot() const;

  /// Its coordinates are those of assemble_scene.
  const ElasticSolid& solid() const { return solid_; }
  /// Of frames and snapshots, as Share has it; on the first of several processes behind the surface's vertices.
  std::vector<int> written_nodes() const { return solid_.share().written_nodes(n_surface()); }
  Eigen::MatrixXi written_cells() const { return solid_.share().written_cells(solid_.cells(), n_surface()); }
  /// 3 x n over these, at rest, along x, y and z (m).
  Eigen::Matrix3Xd X() const { return frame_ * solid_.share().written(solid_.X(), n_surface()); }
  /// On the first of several processes that of all nodes.
  Eigen::Matrix3Xd whole_X() const { return frame_ * solid_.share().written(solid_.X(), solid_.n_nodes()); }
  const ElasticReport& equilibrium() const { return equilibrium_; }   ///< of statics: sums over steps
  const Integrator* integrator() const { return integrator_.get(); }  ///< in time
  double step() const { return step_; }                               ///< of time (s)
  double damping() const { return damping_; }                         ///< mass-proportional (1/s)
  MassMatrix mass() const;
  std::string solver() const;

 private:
  std::vector<std::pair<std::string, double>> strains(const Eigen::Matrix3Xd& u, double max_strain) const;
  void find_collapsing();
  void set_in_motion(double t);
  void count_steps();
  void push_out_of_obstacles();
  void set_length(Eigen::VectorXd length);
  void collapse();
  std::map<int, int> constrained_at(double t) const;
  std::function<Eigen::VectorXd(double t)> motion_of(const std::map<int, int>& constrained) const;
  void release_nodes();
  void check_balance();
  void check_strain();
  int n_surface() const { return static_cast<int>(surface_.X.cols()); }
  const Scheme& scheme() const { return find_scheme(scene_.reference.integrator); }
  double load_factor() const { return static_cast<double>(n_done_) / n_steps_; }

  Scene scene_;
  const SurfaceMesh surface_;
  const TetMesh mesh_;
  StageTimer& timer_;
  Eigen::Matrix3d frame_;  ///< axes of the solid's coordinates, in columns
  ElasticSolid solid_;
  bool is_proportional_, is_solved_ = false;  ///< solved: all equilibria are in proportion to the one found
  double scale_ = 1;                          ///< of the equilibrium found, at the state at hand
  Status status_ = Status::Ok;
  std::string reason_;
  int n_steps_, n_done_ = 0;
  size_t n_constrained_ = 0;  ///< unknowns in the step at hand
  double step_ = 0, damping_ = 0;
  ElasticReport equilibrium_;
  // Of a collapse in motion: the smallest side of the surface's box (m), the part of it that each vertex takes, and
  // as in State.
  double shortest_side_ = 0;
  Eigen::VectorXd collapsing_, length_;
  std::unique_ptr<Integrator> integrator_;
};

}  // namespace testbed::fem
