// The reference program: scene in, frames, curves and a record out.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <optional>

#include "fem_reference/base/memory.h"
#include "fem_reference/base/processes.h"
#include "fem_reference/solid/dynamics.h"
#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solid/problem.h"
#include "fem_reference/solid/richardson.h"
#include "meshing/base/files.h"
#include "meshing/base/stage_timer.h"
#include "meshing/run/exit_status.h"
#include "meshing/run/hash.h"
#include "meshing/run/progress.h"
#include "meshing/run/record.h"
#include "meshing/scene/check.h"
#include "meshing/scene/scene.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tetrahedralize.h"

namespace testbed::fem {
namespace {

struct Arguments {
  std::string scene, out = "out/fem_reference";
  std::vector<std::string> overrides;
  int n_levels = 0, n_frequencies = 0;
  bool is_quiet = false, is_forced = false;
};

/// Load factors to solve for: one where the solution is proportional to it.
struct LoadPath {
  bool is_proportional;
  int n_solves;
  explicit LoadPath(const Scene& scene)
      : is_proportional(fem::is_proportional(scene)), n_solves(is_proportional ? 1 : scene.time.load_steps) {}
  double factor(int n) const { return static_cast<double>(n) / n_solves; }
};

/// What several processes do not solve together; empty: nothing.
std::string undivided_part(const Scene& scene, const Arguments& arguments) {
  if (processes().n == 1) return "";
  const std::string allowed = " under mpirun, expected linear statics";
  if (scene.time.mode != TimeMode::Static) return "time.mode = \"dynamic\"" + allowed;
  if (scene.reference.law != ElasticLaw::SmallStrain)
    return "reference.law other than small_strain" + allowed;
  if (scene.reference.inertia_relief) return "reference.inertia_relief" + allowed + " without it";
  if (arguments.n_frequencies > 0) return "--frequencies" + allowed;
  return "";
}

/// Full-load displacement of the surface's vertices on finer and finer meshes, and the error of the first
/// that they tell.
nlohmann::ordered_json study_convergence(const Scene& scene, const SurfaceMesh& surface, const TetMesh& mesh,
                                         int n_levels, Progress& progress) {
  nlohmann::ordered_json levels = nlohmann::ordered_json::array();
  std::vector<Eigen::Matrix3Xd> u;
  Scene refined = scene;
  for (int level = 0; level < n_levels; ++level, ++refined.reference.refine) {
    ElasticSolid solid = assemble_scene(refined, surface, mesh);
    progress.stage("reference: refinement " + std::to_string(refined.reference.refine) + ", " +
                   std::to_string(solid.n_dofs()) + " unknowns");
    const LoadPath path(scene);
    ElasticReport report;
    for (int n = 1; n <= path.n_solves; ++n) report = solid.solve(path.factor(n));
    if (!report.is_converged) return {{"status", "not_converged"}};
    levels.push_back({{"refine", refined.reference.refine},
                      {"n_dofs", solid.n_dofs()},
                      {"elastic_energy", report.elastic_energy}});
    u.push_back(solid.displacement().leftCols(mesh.n_surface));
  }
  const RefinementError error = richardson(u, surface);
  return {{"status", "ok"},
          {"levels", levels},
          {"error_ratio", error.ratio},
          {"is_ratio_observed", error.is_ratio_observed},
          {"estimated_error_l2", error.of_first},
          {"estimated_error_l2_finest", error.of_last}};
}

/// The row of curves.csv of a state whose surface vertices are at x.
std::vector<std::pair<std::string, double>> curve_row(double time, double load_factor,
                                                      const SurfaceMesh& surface, const Eigen::Matrix3Xd& u,
                                                      double kinetic, double elastic, double max_strain) {
  const Eigen::Matrix3Xd x = surface.X + u.leftCols(surface.X.cols());
  return {{"time", time},
          {"load_factor", load_factor},
          {"volume", volume(x, surface.F)},
          {"area", area(x, surface.F)},
          {"kinetic_energy", kinetic},
          {"elastic_energy", elastic},
          {"max_strain", max_strain},
          {"max_displacement", u.colwise().norm().maxCoeff()}};
}

struct Run {
  const Scene& scene;
  const SurfaceMesh& surface;
  ElasticSolid& solid;
  std::optional<Recorder>& recorder;  // of the first process
  StageTimer& timer;
  Progress& progress;
  nlohmann::ordered_json& record;

  bool is_frame(int n, int last) const {
    const int every = scene.output.frames_every;
    return n == last || (every > 0 && n % every == 0);
  }
};

void run_static(Run& run) {
  const LoadPath path(run.scene);
  const int n_steps = run.scene.time.load_steps;
  ElasticReport report;
  report.is_converged = true;
  int newton_iterations = 0, linear_iterations = 0, n = 0;
  run.progress.stage("reference: solve");
  for (; n <= n_steps; ++n) {
    const double s = static_cast<double>(n) / n_steps;
    if (n > 0 && (n == 1 || !path.is_proportional)) {
      report = run.solid.solve(path.is_proportional ? 1 : s, &run.timer);
      newton_iterations += report.newton_iterations;
      linear_iterations += report.linear_iterations;
      if (!report.is_converged) break;
    }
    run.timer.start("output");
    const double scale = path.is_proportional ? s : 1;  // of the solution at full load
    const Eigen::Matrix3Xd u = scale * run.solid.displacement();
    if (run.recorder && run.scene.output.curves)
      run.recorder->add_row(curve_row(s, s, run.surface, u, 0, scale * scale * report.elastic_energy,
                                      scale * report.max_strain));
    if (run.recorder && run.is_frame(n, n_steps)) run.recorder->add_frame(s, run.solid.X(), u);
    run.progress.update(s);
  }
  run.timer.stop();
  run.record["solver"] = report.solver;
  run.record["newton_iterations"] = newton_iterations;
  run.record["linear_iterations"] = linear_iterations;
  run.record["residual"] = report.residual;
  run.record["tolerance"] = report.tolerance;
  run.record["load_factor_reached"] = report.is_converged ? 1.0 : static_cast<double>(n - 1) / n_steps;
  run.record["status"] = report.is_converged ? "ok" : "not_converged";
}

/// Full loads from rest at t = 0.
void run_dynamic(Run& run) {
  const double end = run.scene.time.end;
  const double step = run.scene.time.step > 0 ? run.scene.time.step : end / kDefaultSteps;
  const int n_steps = meshing::n_steps(run.scene.time, step);
  const bool is_linear = run.scene.reference.law == ElasticLaw::SmallStrain;
  run.timer.start("assemble");
  Dynamics system;
  system.K = run.solid.stiffness();
  system.M = run.solid.mass(run.scene.reference.mass);
  system.damping = run.scene.material.damping;
  system.stiffness_damping = run.scene.material.stiffness_damping;
  system.load = run.solid.load();
  std::map<int, int> held;  // the last of the held components of an unknown
  for (size_t k = 0; k < run.solid.held().size(); ++k) {
    const HeldComponent& h = run.solid.held()[k];
    held[3 * h.node + h.component] = static_cast<int>(k);
  }
  for (const auto& [unknown, k] : held) system.held.push_back(unknown);
  if (run.scene.material.damping_ratio > 0) {
    constexpr int kOneVibration = 7;  // behind at most six rigid motions
    const Modes modes = natural_modes(system.K, system.M, system.held, kOneVibration);
    system.damping += 2 * run.scene.material.damping_ratio * 2 * M_PI * modes.frequency[modes.n_rigid];
  }
  run.record["mass_damping"] = system.damping;
  system.held_motion = [&](double t) {
    Eigen::VectorXd u(static_cast<Eigen::Index>(held.size()));
    Eigen::Index i = 0;
    for (const auto& [unknown, k] : held) u(i++) = run.solid.held_displacement(k, t);
    return u;
  };
  if (!is_linear)
    system.linearise = [&](const Eigen::VectorXd& u, bool with_tangent) {
      return run.solid.linearise(u.reshaped(3, run.solid.X().cols()), 1, with_tangent);
    };
  run.timer.start("solve");
  run.progress.stage("reference: solve");
  const std::optional<double> radius = run.scene.reference.spectral_radius;
  TimeIntegrator motion(std::move(system), step, radius ? generalised_alpha(*radius) : newmark);
  bool is_converged = true;
  for (int n = 0; n <= n_steps; ++n) {
    run.timer.start("solve");
    is_converged = n == 0 || motion.step();
    if (!is_converged) break;
    run.timer.start("output");
    const Eigen::Matrix3Xd u = motion.u().reshaped(3, run.solid.X().cols());
    if (run.scene.output.curves)
      run.recorder->add_row(curve_row(motion.t(), 1, run.surface, u, motion.kinetic_energy(),
                                      motion.elastic_energy(), run.solid.max_strain(u)));
    if (run.is_frame(n, n_steps))
      run.recorder->add_frame(motion.t(), run.solid.X(), u, {{"velocity", motion.v().reshaped(3, u.cols())}});
    run.progress.update(static_cast<double>(n) / n_steps);
  }
  run.timer.stop();
  run.record["solver"] = std::string(radius ? "generalised-alpha" : "Newmark (average acceleration)") +
                         (is_linear ? "" : ", Newton") + ", Cholesky";
  run.record["step"] = step;
  run.record["n_steps"] = n_steps;
  if (!is_linear) run.record["newton_iterations"] = motion.n_newton_iterations();
  run.record["factorisations"] = motion.n_factorisations();
  run.record["time_reached"] = motion.t();
  run.record["status"] = is_converged ? "ok" : "not_converged";
}

ExitStatus run(const Arguments& arguments) {
  const Scene scene = read_scene(arguments.scene, arguments.overrides);
  check_scene(scene, arguments.scene);
  const std::filesystem::path out = arguments.out;
  const bool is_first = processes().rank == 0;
  if (is_first) {
    std::filesystem::create_directories(out);
    write_file(out / "scene.toml", to_toml(scene));
  }
  const auto status_of = [&](const nlohmann::ordered_json& record) {
    return is_first ? tell_status(arguments.scene, record) : kSolved;  // one tells it for all
  };
  if (const std::string part = undivided_part(scene, arguments); !part.empty())
    throw std::runtime_error(arguments.scene + ": " + part);
  if (const std::string part = unmodelled_part(scene); !part.empty()) {
    const nlohmann::ordered_json record{{"status", "not_solved"}, {"reason", part}};
    if (is_first) write_file(out / "run.json", record.dump(2) + "\n");
    return status_of(record);
  }
  Progress progress(arguments.is_quiet || !is_first);
  StageTimer timer;
  timer.start("mesh");
  progress.stage("reference: mesh");
  const SurfaceMesh surface = load_surface(scene.surface);
  timer.stop();  // hashing the program is no part of solving, and takes the longer the larger it is
  const std::string hash =
      hash_of(input_hash(scene, surface, {"network"}) + ' ' + std::to_string(arguments.n_levels) + ' ' +
              std::to_string(arguments.n_frequencies));
  if (const auto stored = stored_record(out, hash); stored && !arguments.is_forced) return status_of(*stored);
  timer.start("mesh");
  TetOptions options;
  options.interior_size = scene.reference.interior_size;
  const TetMesh mesh = from_first_process(is_first ? tetrahedralize(surface, options) : TetMesh());
  const bool is_factor = scene.time.mode == TimeMode::Dynamic || arguments.n_frequencies > 0;
  check_memory(mesh.T.cols(), scene.reference.refine + std::max(0, arguments.n_levels - 1),
               scene.reference.degree, is_factor ? Memory::Factor : Memory::Iterations, memory_available());

  timer.start("setup");
  progress.stage("reference: setup");
  ElasticSolid solid = assemble_scene(scene, surface, mesh);
  timer.stop();
  const int vtk_type = scene.reference.degree == 1 ? 10 : 24;
  // The surface as it was given, refined or not, so that every run of it can be compared vertex by vertex.
  std::optional<Recorder> recorder;
  if (is_first)
    recorder.emplace(out, std::vector<CellBlock>{{5, surface.F}, {vtk_type, solid.cells()}}, mesh.n_surface);

  nlohmann::ordered_json record = environment_record("fem_reference", 1);
  record["processes"] = processes().n;
  record["name"] = scene.name;
  record["input_hash"] = hash;
  record["mesh_hash"] =
      hash_of({reinterpret_cast<const char*>(mesh.X.data()), mesh.X.size() * sizeof(double)});
  record["n_surface"] = mesh.n_surface;
  record["n_nodes"] = solid.X().cols();
  record["n_tetrahedra"] = solid.mesh().T.cols();
  record["n_dofs"] = solid.n_dofs();
  record["degree"] = scene.reference.degree;
  record["is_free"] = solid.n_free_rigid_motions() > 0;
  Run parts{scene, surface, solid, recorder, timer, progress, record};
  if (scene.time.mode == TimeMode::Static) {
    run_static(parts);
    if (arguments.n_levels > 0 && record["status"] == "ok")
      record["convergence"] = study_convergence(scene, surface, mesh, arguments.n_levels, progress);
  } else {
    run_dynamic(parts);
  }
  if (arguments.n_frequencies > 0) {
    std::vector<int> held;
    for (const HeldComponent& h : solid.held()) held.push_back(3 * h.node + h.component);
    const Modes modes =
        natural_modes(solid.stiffness(), solid.mass(scene.reference.mass), held, arguments.n_frequencies);
    record["natural_frequencies"] = std::vector<double>(modes.frequency.begin(), modes.frequency.end());
    record["n_rigid_modes"] = modes.n_rigid;
  }
  for (const auto& [stage, seconds] : timer.seconds()) record["seconds"][stage] = seconds;
  if (recorder) recorder->finish(record);
  return status_of(record);
}

}  // namespace
}  // namespace testbed::fem

int main(int argc, char** argv) {
  testbed::fem::Arguments arguments;
  CLI::App app(
      "Solves a scene by finite elements on tetrahedra of the same surface: the reference.\n\n"
      "Examples:\n"
      "  fem_reference analysis/scenes/ball_pressure.toml\n"
      "  fem_reference scene.toml --set reference.degree=1 --set reference.refine=1 --out out/linear\n"
      "  fem_reference scene.toml --converge 2\n"
      "  mpirun -np 8 fem_reference scene.toml        (linear statics)\n\n"
      "The output folder gets frames.pvd with frames/*.vtu (ParaView), curves.csv, scene.toml (every key "
      "with its\n"
      "value and meaning) and, last, run.json. A run whose inputs have not changed is not repeated.\n");
  app.add_option("scene", arguments.scene, "scene file (.toml)")->required();
  app.add_option("--set", arguments.overrides, "key=value: overrides a key of the scene; may be repeated")
      ->allow_extra_args(false);
  app.add_option("--out", arguments.out, "output folder")->capture_default_str();
  app.add_option(
         "--converge", arguments.n_levels,
         "also solve on this many meshes, each refined once more, and write the estimated error of the "
         "result into run.json")
      ->check(CLI::Range(2, 6));
  app.add_option("--frequencies", arguments.n_frequencies,
                 "also find so many of the lowest natural frequencies (Hz) and write them into run.json")
      ->check(CLI::Range(1, 1000));
  app.add_flag("--quiet", arguments.is_quiet, "no progress on stderr");
  app.add_flag("--force", arguments.is_forced, "run even when nothing has changed");
  app.footer(testbed::kExitStatusHelp);
  if (const auto status = testbed::parse(app, argc, argv)) return *status;
  try {
    return testbed::fem::run(arguments);
  } catch (const std::exception& error) {
    if (testbed::fem::processes().n > 1) testbed::fem::abort_processes(error.what());
    std::cerr << "error: " << error.what() << '\n';
    return testbed::kError;
  }
}
