// The mass-spring program: scene in, frames, curves and a record out.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <sstream>

#include "massspring/calibrations/calibrate.h"
#include "massspring/choices/check_model.h"
#include "massspring/choices/list.h"
#include "massspring/model/collapse.h"
#include "massspring/statics/diagnostics.h"
#include "massspring/statics/frequencies.h"
#include "massspring/statics/quasi_static.h"
#include "massspring/time/implicit_stage.h"
#include "massspring/time/integrators.h"
#include "meshing/base/files.h"
#include "meshing/base/names.h"
#include "meshing/base/stage_timer.h"
#include "meshing/run/exit_status.h"
#include "meshing/run/hash.h"
#include "meshing/run/progress.h"
#include "meshing/run/record.h"
#include "meshing/scene/build_network.h"
#include "meshing/scene/check.h"
#include "meshing/scene/scene.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tet_mesh.h"

namespace testbed::massspring {
namespace {

struct Arguments {
  std::string scene, out = "out/massspring";
  std::vector<std::string> overrides;
  int n_frequencies = 0;
  bool is_quiet = false, is_forced = false, is_undiagnosed = false, is_check = false, is_checked = false;
};

std::vector<CellBlock> cells_of(const SpringNetwork& network) {
  std::vector<CellBlock> cells{{5, network.F}, {3, network.E}};
  if (network.T.cols() > 0) cells.push_back({10, network.T});
  return cells;
}

std::vector<std::pair<std::string, double>> curve_row(const MassSpringModel& model, const State& state,
                                                      double load_factor) {
  const auto& [X, F, E, T, n_surface] = model.network;
  const Eigen::Matrix3Xd x = state.x.leftCols(n_surface);
  double strain = 0;
  for (const auto& s : E.colwise())
    strain = std::max(
        strain,
        std::abs((state.x.col(s(0)) - state.x.col(s(1))).norm() / (X.col(s(0)) - X.col(s(1))).norm() - 1));
  return {{"time", state.t},
          {"load_factor", load_factor},
          {"volume", volume(x, F)},
          {"area", area(x, F)},
          {"kinetic_energy", kinetic_energy(model, state.v)},
          {"elastic_energy", elastic_energy(model, state)},
          {"max_strain", strain},
          {"max_displacement", (state.x - X).colwise().norm().maxCoeff()}};
}

nlohmann::ordered_json to_json(const Diagnostics& diagnostics) {
  return {{"pressure_error", diagnostics.pressure_error},
          {"uniaxial_error", diagnostics.uniaxial_error},
          {"bending_compliance", diagnostics.bending_compliance},
          {"torsion_compliance", diagnostics.torsion_compliance}};
}

/// How far the model can be trusted on this mesh goes into the record; its error in bending and torsion at
/// every node is returned, empty where the model has no answer, as a mechanism has none.
Eigen::VectorXd add_diagnostics(const MassSpringModel& model, nlohmann::ordered_json& record) {
  try {
    const Diagnostics diagnostics = diagnose(model);
    record["diagnostics"] = to_json(diagnostics);
    return diagnostics.node_error;
  } catch (const std::runtime_error& error) {
    record["diagnostics"] = {{"refused", error.what()}};
    return {};
  }
}

/// The solid of a scene, with its skin and volumes.
MassSpringModel model_of(const Scene& scene, const SpringNetwork& network, const Calibration& calibration) {
  const double share = scene.network.link_share;
  MassSpringModel model = share > 0 ? calibrate_with_links(network, scene.material, calibration, share)
                                    : calibrate(network, scene.material, calibration);
  const bool is_explicit_run =
      scene.time.mode == TimeMode::Dynamic && find_integrator(scene.time.integrator).is_explicit;
  if (model.tet_springs && scene.network.mass == MassMatrix::Consistent && !is_explicit_run)
    model.spread_mass = spread_mass(network.X, network.T, scene.material.rho);
  if (model.springs) {
    model.springs->law = scene.network.spring_law;
    model.springs->damping = scene.network.spring_damping;
  }
  if (scene.skin) {
    add_skin(*scene.skin, model);
  }
  if (scene.volume && scene.volume->local > 0) {
    model.local_volume = LocalVolume{scene.volume->local, network.T, Eigen::VectorXd(network.T.cols())};
    for (Eigen::Index t = 0; t < network.T.cols(); ++t)
      model.local_volume->rest_volume(t) = rest_volume(network.X, network.T.col(t));
  }
  return model;
}

ExitStatus run(const Arguments& arguments) {
  const Scene scene = read_scene(arguments.scene, arguments.overrides);
  check_scene(scene, arguments.scene);
  check_model(scene, scene.network.calibration, arguments.scene);
  if (arguments.is_check)
    for (const std::string& model : models_of(scene)) check_model(scene, model, arguments.scene);
  if (!arguments.is_checked)
    if (const auto unused = unused_keys(scene); !unused.empty())
      std::cerr << "unused: " << joined(unused) << '\n';
  if (arguments.is_check) return kSolved;
  const Calibration& calibration = find_calibration(scene.network.calibration);
  const Integrator& integrator = find_integrator(scene.time.integrator);
  const bool is_static = scene.time.mode == TimeMode::Static;

  Progress progress(arguments.is_quiet);
  StageTimer timer;
  timer.start("mesh");
  progress.stage("mass-spring: mesh");
  const SurfaceMesh surface = load_surface(scene.surface);
  timer.stop();  // hashing the program is no part of solving, and takes the longer the larger it is
  const std::string hash = input_hash(scene, surface, {"reference"}) +
                           (arguments.is_undiagnosed ? " undiagnosed" : "") + ' ' +
                           std::to_string(arguments.n_frequencies);
  const std::filesystem::path out = arguments.out;
  std::filesystem::create_directories(out);
  write_file(out / "scene.toml", to_toml(scene));
  if (const auto stored = stored_record(out, hash); stored && !arguments.is_forced)
    return tell_status(arguments.scene, *stored);
  timer.start("mesh");
  const SpringNetwork nodes = build_network(surface, scene.network, calibration.needs_tetrahedra);

  timer.start("setup");
  progress.stage("mass-spring: setup");
  MassSpringModel model = model_of(scene, nodes, calibration);
  const SpringNetwork& network = model.network;
  Forces forces = forces_of(scene, model);
  const Contacts contacts = contacts_of(scene, surface);
  if (model.spread_mass) {
    std::vector<int> driven;
    for (const Constraint& c : forces.constraints)
      if (!c.displacement.isZero(0) || c.motion[0] || c.motion[1] || c.motion[2]) driven.push_back(c.node);
    std::sort(driven.begin(), driven.end());
    gather(driven, *model.spread_mass);
  }
  if (!is_static && scene.material.damping_ratio > 0)
    forces.mass_damping += damping_of_ratio(model, forces.constraints, scene.material.damping_ratio);
  State state = initial_state(model);
  const double rest_volume = state.target_volume;
  constexpr double kSafety = 0.5;  // of the stability limit of the body at rest: springs stiffen under load
  double h = scene.time.step;
  if (!is_static && h == 0)
    h = integrator.is_explicit ? kSafety * stable_step(model, forces, state) : scene.time.end / kDefaultSteps;
  const int n_steps = is_static ? scene.time.load_steps : meshing::n_steps(scene.time, h);
  Recorder recorder(out, cells_of(network), network.n_surface);

  nlohmann::ordered_json record = environment_record("massspring", 1);
  record["name"] = scene.name;
  record["calibration"] = calibration.name;
  record["mass"] = model.spread_mass ? "consistent" : "lumped";
  record["mass_damping"] = forces.mass_damping;
  record["input_hash"] = hash;
  record["mesh_hash"] =
      hash_of({reinterpret_cast<const char*>(network.X.data()), network.X.size() * sizeof(double)});
  record["n_surface"] = network.n_surface;
  record["n_nodes"] = network.X.cols();
  record["n_springs"] = network.E.cols();
  record["n_tetrahedra"] = network.T.cols();
  if (network.T.cols() > 0) record["tetrahedra"] = to_json(tet_quality(network.X, network.T));
  record["is_free"] = false;

  timer.stop();  // what tells a user how far to trust the model is no part of what the model costs
  Eigen::VectorXd node_error;
  if (!arguments.is_undiagnosed) {
    progress.stage("mass-spring: diagnose");
    node_error = add_diagnostics(model, record);
  }
  if (arguments.n_frequencies > 0) {
    const Eigen::VectorXd found = natural_frequencies(model, forces.constraints, arguments.n_frequencies);
    record["natural_frequencies"] = std::vector<double>(found.begin(), found.end());
  }

  timer.start("setup");
  std::unique_ptr<QuasiStaticSolver> equilibrium;
  std::unique_ptr<TimeStepper> stepper;
  if (is_static) {
    equilibrium = std::make_unique<QuasiStaticSolver>(model, forces);
    record["is_free"] = equilibrium->n_free_rigid_motions() > 0;
    record["n_floppy_motions"] = equilibrium->n_floppy_motions();
    record["floppy_load_share"] = equilibrium->floppy_load_share();
  } else {
    IntegratorOptions options;
    options.gradients = {scene.time.volume_gradient, scene.time.bend_gradient};
    options.linear_solver = scene.time.linear_solver;
    options.tolerance = scene.time.tolerance;
    options.sleep_below = scene.time.sleep_below;
    stepper = std::make_unique<TimeStepper>(model, forces, scene.time.integrator, scene.time.end, options,
                                            contacts);
    record["step"] = h;
    if (integrator.is_linearised)
      record["tolerance"] = options.linear_tolerance;
    else if (!integrator.is_explicit)
      record["tolerance"] = ImplicitStage::kStepTolerance;
  }
  record["n_steps"] = n_steps;

  const auto write_frame = [&] {
    timer.start("output");
    std::vector<Field> fields;
    if (!is_static) fields.push_back({"velocity", state.v});
    if (node_error.size() > 0) fields.push_back({"node_error", node_error.transpose()});
    recorder.add_frame(state.t, network.X, state.x - network.X, fields);
  };
  const auto write_row = [&] {
    timer.start("output");
    if (scene.output.curves) recorder.add_row(curve_row(model, state, is_static ? state.t : 1));
  };

  const auto set_target_volume = [&](double t) {
    if (!scene.volume) return;
    if (!scene.volume->target.empty())
      state.target_volume = rest_volume * value_at(scene.volume->target, t);
    else if (scene.collapse)  // [paper 4.4]
      state.target_volume = volume(state.x, network.F);
  };
  const int every = scene.output.frames_every;
  if (every > 0) write_frame();
  write_row();
  progress.stage("mass-spring: solve");
  StepReport report;
  int newton_iterations = 0, linear_iterations = 0, n_done = 0, n_at_rest = 0, n_halved = 0;
  Status status = Status::Ok;
  const auto has_ended = [&] {
    return n_done == n_steps || status == Status::Diverged || (is_static && status == Status::NotConverged);
  };
  while (!has_ended()) {
    timer.start("solve");
    if (is_static) {
      const double load_factor = static_cast<double>(n_done + 1) / n_steps;
      if (scene.collapse) collapse_to(*scene.collapse, model, load_factor, state);
      set_target_volume(load_factor);
      report = equilibrium->solve(load_factor, state);
      state.t = load_factor;
    } else {
      if (scene.collapse) collapse(*scene.collapse, model, h, state);
      if (scene.skin && scene.skin->relaxation > 0) relax_surface(scene.skin->relaxation, model, h, state);
      set_target_volume(state.t + h);
      report = stepper->step(state, h);
    }
    if (report.status != Status::Ok) status = report.status;
    newton_iterations += report.newton_iterations;
    linear_iterations += report.linear_iterations;
    n_at_rest += report.is_at_rest;
    n_halved += report.is_halved;
    ++n_done;
    write_row();
    if (has_ended() || (every > 0 && n_done % every == 0)) write_frame();
    progress.update(static_cast<double>(n_done) / n_steps);
  }
  timer.stop();

  record["n_steps_done"] = n_done;
  if (scene.time.sleep_below > 0) record["n_steps_at_rest"] = n_at_rest;
  if (n_halved > 0) record["n_steps_halved"] = n_halved;
  record["newton_iterations"] = newton_iterations;
  record["linear_iterations"] = linear_iterations;
  record["residual"] = report.residual;
  if (is_static) record["tolerance"] = QuasiStaticSolver::kTolerance;
  if (stepper && !stepper->solver_choice().empty()) record["solver"] = stepper->solver_choice();
  for (const auto& [stage, seconds] : timer.seconds()) record["seconds"][stage] = seconds;
  record["status"] = name_of(status);
  if (is_static && status != Status::Ok) {
    std::ostringstream reason;
    reason << "load factor " << state.t << ", step " << n_done << " of " << n_steps << ": "
           << (report.reason.empty() ? name_of(status) : report.reason);
    record["reason"] = reason.str();
  }
  recorder.finish(record);
  return tell_status(arguments.scene, record);
}

}  // namespace
}  // namespace testbed::massspring

int main(int argc, char** argv) {
  testbed::massspring::Arguments arguments;
  CLI::App app(
      "Simulates a closed surface as a mass-spring solid.\n\n"
      "Examples:\n"
      "  massspring analysis/scenes/ball_pressure.toml\n"
      "  massspring scene.toml --set network.calibration=uniform --set material.nu=0.3 --out out/soft\n\n"
      "The output folder gets frames.pvd with frames/*.vtu (ParaView), curves.csv, scene.toml (every key "
      "with its\n"
      "value and meaning) and, last, run.json. A run whose inputs have not changed is not repeated.\n");
  app.add_option("scene", arguments.scene, "scene file (.toml)")->required();
  app.add_option("--set", arguments.overrides, "key=value: overrides a key of the scene; may be repeated")
      ->allow_extra_args(false);
  app.add_option("--out", arguments.out, "output folder")->capture_default_str();
  app.add_option("--frequencies", arguments.n_frequencies,
                 "also find so many of the lowest natural frequencies (Hz) and write them into run.json")
      ->check(CLI::Range(1, 1000));
  app.add_flag("--quiet", arguments.is_quiet, "no progress on stderr");
  app.add_flag(
      "--no-diagnostics", arguments.is_undiagnosed,
      "do not measure the model against exact fields, which takes longer than the run of a large one");
  app.add_flag("--force", arguments.is_forced, "run even when nothing has changed");
  app.add_flag("--check", arguments.is_check,
               "check the scene and every model that comparison.calibrations names, then end");
  app.add_flag("--checked", arguments.is_checked, "the scene has been checked: do not name its unused keys");
  app.add_flag_callback(
      "--list",
      [] {
        std::cout << testbed::massspring::list_choices().dump(2) << '\n';
        throw CLI::Success();
      },
      "print spring models, integrators and keys of scenes as JSON, then end");
  app.footer(testbed::kExitStatusHelp);
  if (const auto status = testbed::parse(app, argc, argv)) return *status;
  try {
    return testbed::massspring::run(arguments);
  } catch (const std::exception& error) {
    std::cerr << "error: " << error.what() << '\n';
    return testbed::kError;
  }
}
