// The mass-spring program: scene in, frames, curves and a record out.
#include <omp.h>

#include <cmath>
#include <iostream>

#include "massspring/adapt.h"
#include "massspring/calibrations/calibrate.h"
#include "massspring/choices/check_model.h"
#include "massspring/choices/list.h"
#include "massspring/choices/paper.h"
#include "massspring/simulation.h"
#include "massspring/statics/diagnostics.h"
#include "massspring/statics/frequencies.h"
#include "meshing/base/names.h"
#include "meshing/network/build_network.h"
#include "meshing/run/session.h"
#include "meshing/scene/check.h"

namespace testbed::massspring {
namespace {

struct Arguments : SessionOptions {
  bool is_undiagnosed = false, is_check = false;
};

/// What exerts force, behind the scene's surface.
std::vector<CellBlock> cells_of(const MassSpringModel& model) {
  std::vector<CellBlock> cells;
  if (model.springs) cells.push_back({3, model.springs->E});
  if (model.tet_springs || model.local_volume) cells.push_back({10, model.network.T});
  return cells;
}

void describe(const NodeReport& found, nlohmann::ordered_json& record) {
  if (const auto& most = found.samples.most_nodes)
    record["internal_nodes"] = {
        {"bounded_by", *most}, {"phi", found.samples.phi}, {"psi", found.samples.psi}};
  if (found.is_mesher_instead) record["internal_nodes"] = {{"sampling", "mesher"}};
  if (!found.tets.mesher.empty()) record.update(to_json(found.tets));
}

void describe(const Simulation& simulation, const Scene& scene, nlohmann::ordered_json& record) {
  const MassSpringModel& model = simulation.model();
  const Eigen::Matrix4Xi& T = model.network.T;
  record["calibration"] = scene.network.calibration;
  record["geometry"] = model.linear ? "linear" : "full";
  if (const std::string& reason = simulation.report().full_geometry; !reason.empty())
    record["geometry_reason"] = reason;
  record["mass"] = model.consistent_mass ? "consistent" : "lumped";
  record["mass_damping"] = simulation.forces().mass_damping;
  record["n_springs"] = model.springs ? model.springs->E.cols() : 0;
  record["n_patches"] = model.tet_springs ? model.tet_springs->n_patches() : 0;
  const bool forms_matrix = simulation.is_static() ? !model.linear || !model.tet_springs
                                                   : !find_integrator(scene.time.integrator).is_explicit;
  if (forms_matrix) record["n_blocks"] = n_stiffness_blocks(model);
  record["n_tetrahedra"] = T.cols();
  if (T.cols() > 0) record["tetrahedra"] = to_json(tet_quality(model.network.X, T));
  record["is_free"] = false;
  if (const QuasiStaticSolver* equilibrium = simulation.equilibrium()) {
    record["is_free"] = equilibrium->n_free_rigid_motions() > 0;
    record["n_floppy_motions"] = equilibrium->n_floppy_motions();
    record["floppy_load_share"] = equilibrium->floppy_load_share();
  } else {
    record["step"] = simulation.step();
  }
}

/// How far the model can be trusted on this mesh goes into the record and its error in bending and torsion at
/// every node into the frames, unless the model has no answer, as a mechanism has none.
void add_diagnostics(const MassSpringModel& model, Session& session) {
  session.progress.stage("massspring: diagnose");
  nlohmann::ordered_json& found = session.record["diagnostics"];
  try {
    const Diagnostics diagnostics = diagnose(model);
    found = {{"pressure_error", diagnostics.pressure_error},
             {"uniaxial_error", diagnostics.uniaxial_error},
             {"bending_error", diagnostics.bending_error},
             {"torsion_error", diagnostics.torsion_error},
             {"bending_compliance", diagnostics.bending_compliance},
             {"torsion_compliance", diagnostics.torsion_compliance}};
    session.fields.push_back({"node_error", diagnostics.node_error.transpose()});
  } catch (const std::runtime_error& error) {
    found = {{"refused", error.what()}};
  }
}

/// Into the record, and at every vertex of the surface into the frames that follow.
void add_estimate(const ErrorEstimate& estimate, const SpringNetwork& network, Session& session) {
  session.record["estimated_error"] = estimate.error;
  Eigen::MatrixXd of_node = Eigen::MatrixXd::Zero(1, network.X.cols());
  of_node.leftCols(estimate.of_vertex.size()) = estimate.of_vertex.transpose();
  session.fields.push_back({"estimated_error", of_node});
}

void add_adapted(const AdaptedSurface& adapted, Session& session) {
  session.record["adapted"] = {
      {"n_nodes", adapted.n_nodes}, {"estimated_errors", adapted.errors}, {"is_reached", adapted.is_reached}};
  add_estimate(adapted.estimate, adapted.network, session);
}

/// Of the equilibrium under full load; where there is none, why.
void estimate(const Simulation& simulation, const Scene& scene, const SpringNetwork& network,
              const Arguments& arguments, Session& session) {
  if (simulation.status() != Status::Ok) return;
  std::string why_not = why_not_estimated(scene, find_calibration(scene.network.calibration));
  if (why_not.empty() && arguments.budget) why_not = "a budget of time is spent on solutions alone";
  if (why_not.empty() && has_friction(scene))
    why_not = "friction hangs on all load steps, which finer springs would take anew";
  if (const double ratio = why_not.empty() ? edges_over_thickness(network) : 0; ratio > kTooThin)
    why_not = "edges are " + std::to_string(std::lround(ratio)) +
              " times as long as the body is thick, of at most " + std::to_string(std::lround(kTooThin)) +
              ": finer springs bend as little";
  if (!why_not.empty()) {
    session.record["not_estimated"] = why_not;
    return;
  }
  session.start("estimate");
  try {
    add_estimate(estimate_error(scene, network, simulation.snapshot().u, &simulation), network, session);
  } catch (const std::runtime_error& error) {
    session.record["not_estimated"] = error.what();
  }
}

void report(const Simulation& simulation, const Scene& scene, nlohmann::ordered_json& record) {
  const SimulationReport& report = simulation.report();
  record["n_steps"] = report.n_steps;
  record["n_steps_done"] = simulation.n_done();
  if (scene.time.sleep_below > 0) record["n_steps_at_rest"] = report.n_at_rest;
  if (report.n_halved > 0) record["n_steps_halved"] = report.n_halved;
  record["newton_iterations"] = report.newton_iterations;
  record["linear_iterations"] = report.linear_iterations;
  record["residual"] = report.residual;
  if (report.tolerance) record["tolerance"] = *report.tolerance;
  if (!report.solver.empty()) record["solver"] = report.solver;
  if (!simulation.is_static()) record["energy_gain"] = simulation.state().ledger.gain();
  record["status"] = name_of(report.status);
  if (!report.reason.empty()) record["reason"] = report.reason;
}

/// What a unit of the coordinates of the file, or of the shape, measures in the body that is normalised (m).
double normalised_unit(SurfaceSource source) {
  source.normalise = false;
  source.scale = 1;
  source.unit = LengthUnit::Metre;
  const Eigen::Matrix3Xd X = load_surface(source).X;
  return 1 / (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).minCoeff();
}

/// Of a scene that has been checked.
nlohmann::ordered_json extent_of(const Scene& scene, const SurfaceMesh& surface) {
  nlohmann::ordered_json extent{{"n_vertices", surface.X.cols()},
                                {"n_vertices_cut", cut_for(scene, surface).surface.X.cols()},
                                {"models", models_of(scene)},
                                {"law", name_of(law_of(scene))},
                                {"mode", name_of(scene.time.mode)}};
  if (scene.surface.normalise) extent["normalised_unit"] = normalised_unit(scene.surface);
  return extent;
}

/// Checks the scene for its own spring model or for all that it names, and tells which keys none of them reads.
void check_keys(const Scene& scene, const Arguments& arguments) {
  check_scene(scene, arguments.scene);
  check_model(scene, scene.network.calibration, arguments.scene);
  if (arguments.is_check)
    for (const std::string& model : models_of(scene)) check_model(scene, model, arguments.scene);
  if (arguments.is_checked) return;
  if (const auto unused = unused_keys(scene); !unused.empty())
    std::cerr << "unused: " << joined(unused) << '\n';
}

/// Checks what the scene asks of its surface and tells what was probably not meant, and the scene's extent.
void check_surface(const Scene& scene, const Arguments& arguments) {
  const SurfaceMesh surface = load_surface(scene.surface);
  Scene unscaled = scene;  // the factor that load_scale.strain wants is found by a run
  unscaled.load_scale = {};
  check_supports(scene, surface, discretise(unscaled, surface), arguments.scene);
  if (arguments.n_frequencies == 0) check_motion(scene, surface, arguments.scene);
  for (const std::string& warning : warnings_about(scene, surface, arguments.scene))
    std::cerr << "warning: " << warning << '\n';
  std::cout << extent_of(scene, surface) << '\n';
}

/// Seconds of set-up, diagnosis and steps on one core of the 2020s, to a factor of two or so. Absent where the length of
/// a step is known to a body alone that is set up.
std::optional<double> foreseen_seconds(const Scene& scene, Eigen::Index n_nodes, bool has_links,
                                       bool is_diagnosed) {
  const auto n = static_cast<double>(n_nodes);
  const auto growth = [n](double exponent) { return std::pow(n / 2000, exponent); };  // of a node's share
  const bool is_linear = law_of(scene) == MaterialLaw::SmallStrain;
  const TimeOptions& time = scene.time;
  const bool is_static = time.mode == TimeMode::Static;
  // Floppy motions of links are counted where forces are linear or balanced.
  double set_up = n * (!has_links ? 3.5e-5 : is_static || is_linear ? 2e-4 : 0);
  if (is_diagnosed && !has_links) set_up += n * 1e-4 * growth(0.6);
  if (is_static && is_linear) {
    const double of_model =
        scene.network.calibration == "edge_coupled" ? 0.4 : 1;  // its patches have fewer nodes
    return of_model * (set_up + n * 6e-5 * growth(0.6));
  }
  if (is_static) return set_up + n * 1.5e-5 * growth(1.3) * time.load_steps;
  const bool is_explicit = find_integrator(time.integrator).is_explicit;
  if (is_explicit && time.step == 0) return {};
  const bool has_contacts = !scene.obstacles.empty() || scene.self_contact.is_on;
  const double of_step = is_explicit                  ? (has_links ? 3e-8 : 1e-7)
                         : is_linear                  ? 3e-6 * growth(1)
                         : has_links && !has_contacts ? 1e-6
                                                      : 1e-5 * growth(0.7);
  return set_up + meshing::n_steps(time, time.step == 0 ? time.end / kDefaultSteps : time.step) * n * of_step;
}

ExitStatus run(const Arguments& arguments) {
  Scene scene = read_scene(arguments.scene, arguments.overrides);
  if (scene.is_paper) set_paper_method(scene);
  check_keys(scene, arguments);
  if (arguments.is_check) {
    check_surface(scene, arguments);
    return kSolved;
  }
  Session session("massspring", arguments, scene);
  const Calibration& calibration = find_calibration(scene.network.calibration);
  const std::string options =
      (arguments.is_undiagnosed ? "undiagnosed " : "") + std::to_string(arguments.n_frequencies);
  if (const auto stored = session.stored_status({"reference"}, options)) return *stored;

  session.start("mesh");
  const bool needs_links = calibration.needs_links || scene.network.link_share > 0;
  NodeReport found;
  const bool is_adapted = scene.network.target_error > 0 && why_not_estimated(scene, calibration).empty();
  SpringNetwork network;
  const auto fill = [&](const SurfaceMesh& surface) {
    if (is_adapted) {
      session.start("adapt");
      AdaptedSurface adapted = adapt_surface(scene, surface, scene.network.target_error);
      add_adapted(adapted, session);
      network = std::move(adapted.network);
    } else {
      network = build_network(surface, scene.network, needs_links, calibration.needs_tetrahedra, &found);
    }
  };
  if (needs_links)
    fill(session.surface);
  else
    session.cut_surface(fill);
  session.foresee(network.X.cols(),
                  foreseen_seconds(scene, network.X.cols(), needs_links, !arguments.is_undiagnosed));
  session.start("setup");
  Simulation simulation(scene, network);
  session.timer.stop();  // what tells a user how far to trust the model is no part of what the model costs
  const MassSpringModel& model = simulation.model();
  session.open(model.network.X, surface_of(model), cells_of(model), omp_get_max_threads());
  describe(found, session.record);
  if (const auto& most = found.samples.most_nodes; most && !found.is_mesher_instead && !arguments.is_checked)
    session.progress.tell("the network has at most " + std::to_string(*most) +
                          " nodes inside, three for each of the surface: network.k asks for more");
  describe(simulation, scene, session.record);
  if (!arguments.is_undiagnosed) add_diagnostics(model, session);
  if (arguments.n_frequencies > 0) {
    const auto [frequency, n_zero] = natural_frequencies(model, simulation.forces(), arguments.n_frequencies);
    session.record["natural_frequencies"] = std::vector<double>(frequency.begin(), frequency.end());
    session.record["n_zero_frequencies"] = n_zero;
  }
  take_steps(simulation, session, [&] {
    if (scene.network.estimate && !is_adapted) estimate(simulation, scene, network, arguments, session);
  });
  report(simulation, scene, session.record);
  return session.finish();
}

}  // namespace
}  // namespace testbed::massspring

int main(int argc, char** argv) {
  using namespace testbed;
  massspring::Arguments arguments;
  arguments.out = "out/massspring";
  CLI::App app(
      "Simulates a closed surface as a mass-spring solid.\n\n"
      "Examples:\n"
      "  massspring analysis/scenes/ball_pressure.toml\n"
      "  massspring scene.toml --set network.calibration=uniform --set material.nu=0.3 --out out/soft\n");
  app.add_flag(
      "--no-diagnostics", arguments.is_undiagnosed,
      "do not measure the model against exact fields, which takes longer than the run of a large one");
  app.add_flag(
      "--check", arguments.is_check,
      "check the scene and every model that comparison.calibrations names, print its extent as JSON, "
      "then end");
  app.add_flag_callback(
      "--list",
      [] {
        std::cout << massspring::list_choices().dump(2) << '\n';
        throw CLI::Success();
      },
      "print spring models, integrators and keys of scenes as JSON, then end");
  return run_program(app, argc, argv, arguments, [&] { return massspring::run(arguments); });
}
