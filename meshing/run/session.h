// A run of a program on a scene, from its command line to its record: what is the same for both solvers.
#pragma once

#include <CLI/CLI.hpp>
#include <chrono>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "meshing/base/folder_lock.h"
#include "meshing/base/stage_timer.h"
#include "meshing/run/budget.h"
#include "meshing/run/checkpoint.h"
#include "meshing/run/exit_status.h"
#include "meshing/run/progress.h"
#include "meshing/run/record.h"
#include "meshing/scene/scene.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface/cut_surface.h"

namespace testbed::meshing {

struct SessionOptions {
  std::string scene, out;
  std::vector<std::string> overrides;
  int n_frequencies = 0;
  std::optional<double> budget;  ///< s of wall-clock time
  bool is_quiet = false, is_forced = false, is_checked = false;
};

/// Reads both programs' common options, and further ones that are in `app`, and calls `run`.
/// @return the exit status of the program
int run_program(CLI::App& app, int argc, char** argv, SessionOptions& options,
                const std::function<ExitStatus()>& run);

/// Of this process and of those that it has waited for (s).
double cpu_time();

class Session {
 public:
  /// Locks the output folder, and waits for another process that holds it. From here on its budget runs: a run that goes
  /// on for too long beyond it is ended with the status "stopped_early", wherever it is, and keeps what it has. The stage "start-up" is the CPU time so far:
  /// what loading libraries costs, which the clock of the first stage has not seen.
  /// @param is_first  of the processes that solve it together: it alone writes and speaks
  /// @param of_first  what it has decided, on all; absent: there is one
  Session(const std::string& program, const SessionOptions& options, Scene scene, bool is_first = true,
          std::function<bool(bool)> of_first = {});

  /// Writes a record that says why the program does not model the scene.
  ExitStatus refuse(const std::string& reason);

  /// The status of a finished run of the same inputs, if there is one that may stand, and whose files are there as they
  /// were written; else removes what an older run left. Writes the scene with all its keys to the output folder, and
  /// surface_file.vtu where the surface is a file's. Warns of what was probably not meant, but for a scene that has been
  /// checked. Of several processes the first alone decides.
  /// @param ignored  keys of the scene that the program does not read
  /// @param options  of the command line that its results depend on
  std::optional<ExitStatus> stored_status(const std::vector<std::string>& ignored,
                                          const std::string& options);

  /// Begins a stage: its time counts as that of `name`.
  void start(const std::string& name);

  /// The surface as the scene wants it cut, once it has been filled. Where that fails it is cut to edges of twice the
  /// length, then not at all; the record tells why.
  /// @param fill  with nodes. What it throws for a surface that is not cut is thrown.
  SurfaceMesh cut_surface(const std::function<void(const SurfaceMesh&)>& fill);

  /// Tells how many nodes are solved for and, where that is foreseen, some seconds that it takes; of a long run what
  /// takes less. Keeps them in the record.
  void foresee(Eigen::Index n_nodes, std::optional<double> seconds);

  /// Frames hold the triangles of the surface that is solved on, then these cells, over nodes X (3 x n, m) at rest. Of
  /// several processes each has a piece of them, the first with the surface.
  /// Volume and area in curves.csv are those of that surface.
  /// @param solved     its vertices are the first nodes
  /// @param n_threads  that the solver may use
  void open(const Eigen::Matrix3Xd& X, const SurfaceMesh& solved, std::vector<CellBlock> cells, int n_threads,
            Piece piece = {});
  /// The list of the files that this process has written so far, in JSON.
  std::string outputs() { return recorder_->recorded().outputs.dump(); }

  /// Whether a frame is due after n steps.
  bool needs_frame(int n, bool is_last) const;
  /// Whether a row of curves.csv or a frame is: without, a step costs no snapshot.
  bool needs_snapshot(int n, bool is_last) const;

  /// What the run goes on from, as its simulation was saved; null: it begins anew.
  const std::string* saved_simulation() const { return before_ ? &before_->simulation : nullptr; }
  /// Whether a motion is to be saved now.
  bool needs_checkpoint() const;
  /// Before what it adds after the step at hand.
  void save(std::string simulation);

  /// All processes ask after the same step.
  bool is_spent() const { return of_first_ ? of_first_(budget_.is_spent()) : budget_.is_spent(); }
  /// After n of so many steps, with a result that says so.
  void stop_early(int n, int n_steps);

  /// Adds a row of curves.csv and a frame, each where it is due after n steps.
  void add(const Snapshot& snapshot, int n, bool is_last);

  /// Writes curves and record, which says what of its time this process had a core: less than all where it waited.
  ExitStatus finish();

  const Scene scene;
  SurfaceMesh surface;
  Progress progress;
  StageTimer timer;
  nlohmann::ordered_json record;
  std::vector<Field> fields;  ///< that every frame shows besides its snapshot's

 private:
  using Clock = std::chrono::steady_clock;

  ExitStatus tell(const nlohmann::ordered_json& result) const;
  void tell(const CutSurface& found);
  void write_scene() const;
  void write_surface_file() const;
  void end_overdue();
  std::map<std::string, double> sums() const;

  std::string program_, file_, hash_;
  std::filesystem::path out_;
  bool is_forced_, is_quiet_, is_checked_, finds_frequencies_, is_first_, is_saved_ = false;
  std::function<bool(bool)> of_first_;
  Eigen::Matrix3Xd X_;
  SurfaceMesh solved_;
  SurfaceProblem problem_;          ///< on the surface as it was read: what two programs must have in common
  std::optional<FolderLock> lock_;  ///< of the first process, as the next
  std::optional<Recorder> recorder_;
  Clock::time_point begin_ = Clock::now(), saved_ = begin_;
  double cpu_begin_;  ///< s
  std::optional<Checkpoint> before_;
  std::string stopped_early_;  ///< why; empty: it was not

  std::mutex writing_;  ///< is held while something is written, and guards what follows
  bool has_folder_ = false, may_end_ = true;
  std::string stage_;
  nlohmann::ordered_json known_;  ///< of the record, for an end wherever it is

  Budget budget_;  ///< last: its thread sees all of the above
};

/// Takes all steps of a simulation, each of which leaves a snapshot where it counts as done. A motion goes on from its
/// checkpoint.
/// @param at_end  is called once all steps are done, before the last snapshot is added
template <class Simulation>
void take_steps(
    Simulation& simulation, Session& session, const std::function<void()>& at_end = [] {}) {
  bool is_over = false;
  const auto add = [&] {
    if (simulation.has_ended()) at_end();
    session.timer.start("output");
    const int n = simulation.n_done();
    const bool is_spent = !simulation.has_ended() && session.is_spent();
    is_over = simulation.has_ended() || is_spent;
    if (is_spent || (!is_over && session.needs_checkpoint())) session.save(simulation.saved());
    if (session.needs_snapshot(n, is_over)) session.add(simulation.snapshot(), n, is_over);
    if (is_spent) session.stop_early(n, simulation.n_steps());
    session.progress.update(simulation.progress());
  };
  session.start("solve");
  if (const std::string* saved = session.saved_simulation()) simulation.restore(*saved);
  add();
  while (!is_over) {
    session.timer.start("solve");
    const int n = simulation.n_done();
    simulation.advance();
    if (simulation.n_done() > n)
      add();
    else
      is_over = simulation.has_ended();
  }
  session.timer.stop();
}

}  // namespace testbed::meshing
