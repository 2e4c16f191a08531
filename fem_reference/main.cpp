// The reference program: scene in, frames, curves and a record out.
#include <algorithm>
#include <optional>

#include "fem_reference/base/memory.h"
#include "fem_reference/base/processes.h"
#include "fem_reference/solid/natural_modes.h"
#include "fem_reference/solid/problem.h"
#include "fem_reference/solid/richardson.h"
#include "fem_reference/solid/simulation.h"
#include "meshing/algebra/status.h"
#include "meshing/base/child_process.h"
#include "meshing/network/network.h"
#include "meshing/run/hash.h"
#include "meshing/run/session.h"
#include "meshing/scene/check.h"
#include "meshing/tetrahedra/interior_size.h"
#include "meshing/tetrahedra/tetrahedralize.h"

namespace testbed::fem {
namespace {

struct Arguments : SessionOptions {
  int n_levels = 0;
};

/// Full-load displacement of the surface's vertices on finer and finer meshes, and the error of the first
/// that they tell.
nlohmann::ordered_json study_convergence(Session& session, const SurfaceMesh& surface, const TetMesh& mesh,
                                         int n_levels) {
  const Scene& scene = session.scene;
  nlohmann::ordered_json levels = nlohmann::ordered_json::array();
  std::vector<Eigen::Matrix3Xd> u;
  Scene refined = scene;
  for (int level = 0; level < n_levels; ++level, ++refined.reference.refine) {
    ElasticSolid solid = assemble_scene(refined, surface, mesh);
    session.progress.stage("reference: refinement " + std::to_string(refined.reference.refine) + ", " +
                           std::to_string(solid.n_dofs()) + " unknowns");
    const int n_solves = is_proportional(scene) ? 1 : scene.time.load_steps;
    ElasticReport report;
    for (int n = 1; n <= n_solves; ++n) report = solid.solve(static_cast<double>(n) / n_solves);
    if (!report.is_converged) return {{"status", "not_converged"}};
    levels.push_back({{"refine", refined.reference.refine},
                      {"n_dofs", solid.n_dofs()},
                      {"elastic_energy", report.elastic_energy}});
    const auto n = static_cast<int>(surface.X.cols());
    const Eigen::Matrix3Xd written = solid.share().written(solid.displacement(), n);
    if (processes().rank == 0) u.push_back(written.leftCols(n));
  }
  if (u.empty()) return {};
  const RefinementError error = richardson(u, surface);
  return {{"status", "ok"},
          {"levels", levels},
          {"error_ratio", error.ratio},
          {"is_ratio_observed", error.is_ratio_observed},
          {"estimated_error_l2", error.of_first},
          {"estimated_error_l2_finest", error.of_last}};
}

/// Tetrahedra of a whole surface around points as the springs have, from which meshers recover some surfaces that they
/// refuse without; none where they refuse it so, too.
std::optional<TetMesh> fill_around_points(const SurfaceMesh& surface, TetOptions options,
                                          TetReport& attempts) {
  options.interior = meshing::sample_interior(surface, {});
  options.size = meshing::largest_size(surface);
  options.ends_when_stopped = true;
  TetReport around_points;
  try {
    TetMesh mesh = tetrahedralize(surface, options, &around_points);
    attempts.mesher = around_points.mesher + ", around points";
    return mesh;
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
}

/// Tetrahedra of the surface, whose nodes inside a mesher chooses. A surface that is cut may be cut less where none fills it.
TetMesh fill(const SurfaceMesh& surface, const Scene& scene, TetReport& attempts) {
  TetOptions options;
  options.interior_size = scene.reference.interior_size;
  try {
    return tetrahedralize(surface, options, &attempts);
  } catch (const std::runtime_error&) {
    if (surface.cuts.F.size() > 0) throw;
    std::optional<TetMesh> mesh = fill_around_points(surface, options, attempts);
    if (!mesh) throw;
    return *std::move(mesh);
  }
}

void describe(const Simulation& simulation, const Scene& scene, nlohmann::ordered_json& record) {
  const ElasticSolid& solid = simulation.solid();
  record["processes"] = processes().n;
  record["n_tetrahedra"] = solid.share().n_tetrahedra;
  record["n_dofs"] = solid.n_dofs();
  record["degree"] = scene.reference.degree;
  record["is_free"] = solid.n_free_rigid_motions() > 0;
  if (processes().n == 1) return;
  record["n_nodes"] = solid.n_nodes();  // and not those that the first process writes
  record["mesh_hash"] = meshing::hash_of_nodes(simulation.whole_X());
}

/// Seconds of the steps on one core of the 2020s, to a factor of two or so.
double foreseen_seconds(const Simulation& simulation, const Scene& scene) {
  const auto n = static_cast<double>(simulation.solid().n_nodes());
  const bool is_linear = law_of(scene) == MaterialLaw::SmallStrain;
  if (!simulation.integrator()) return n * (is_linear ? 1e-4 : 2.8e-4 * scene.time.load_steps);
  const bool is_explicit = find_scheme(scene.reference.integrator).is_explicit();
  return simulation.n_steps() * n * (is_explicit ? 1e-6 : is_linear ? 6e-6 : 4e-5);
}

void report(const Simulation& simulation, const Scene& scene, nlohmann::ordered_json& record) {
  record["solver"] = simulation.solver();
  if (const Integrator* integrator = simulation.integrator()) {
    const bool is_explicit = find_scheme(scene.reference.integrator).is_explicit();
    record["integrator"] = scene.reference.integrator;
    record["mass"] = name_of(simulation.mass());
    record["mass_damping"] = simulation.damping();
    record["step"] = simulation.step();
    record["n_steps"] = simulation.n_steps();
    if (integrator->counts().newton_iterations > 0)
      record["newton_iterations"] = integrator->counts().newton_iterations;
    if (integrator->counts().halved > 0) record["n_steps_halved"] = integrator->counts().halved;
    if (!is_explicit) record["factorisations"] = integrator->counts().factorisations;
    record["time_reached"] = integrator->t();
    record["energy_gain"] = integrator->ledger().gain();
  } else {
    const ElasticReport& equilibrium = simulation.equilibrium();
    record["newton_iterations"] = equilibrium.newton_iterations;
    record["linear_iterations"] = equilibrium.linear_iterations;
    record["residual"] = equilibrium.residual;
    record["tolerance"] = equilibrium.tolerance;
    record["load_factor_reached"] = static_cast<double>(simulation.n_done()) / simulation.n_steps();
  }
  record["status"] = name_of(simulation.status());
  if (!simulation.reason().empty()) record["reason"] = simulation.reason();
}

/// What processes told each other, and what each took: CPU time (s) without and within MPI's calls, largest memory (byte).
void report_processes(Session& session) {
  if (processes().n == 1) return;
  nlohmann::ordered_json& record = session.record;
  for (const std::string& outputs : to_first_process(session.outputs()))
    record["outputs"].update(nlohmann::ordered_json::parse(outputs));
  const Traffic own = traffic();
  const double cpu = meshing::cpu_time();
  const auto each = [](double value) { return to_first_process(value); };
  record["of_processes"] = {{"messages", each(static_cast<double>(own.messages))},
                            {"bytes", each(static_cast<double>(own.bytes))},
                            {"sums", each(static_cast<double>(own.sums))},
                            {"cpu", each(cpu - own.cpu)},
                            {"cpu_in_mpi", each(own.cpu)},
                            {"peak_memory", each(meshing::peak_memory())}};
}

void add_frequencies(const ElasticSolid& solid, MassMatrix mass, int n, nlohmann::ordered_json& record) {
  Dynamics system = dynamics_of(solid, mass);
  for (const ConstrainedComponent& h : solid.constrained())
    system.constrained.push_back(3 * h.node + h.component);
  const Modes modes = natural_modes(system, solid, n);
  record["natural_frequencies"] = std::vector<double>(modes.frequency.begin(), modes.frequency.end());
  record["n_zero_frequencies"] = modes.n_rigid;
}

ExitStatus run(const Arguments& arguments) {
  const bool is_first = processes().rank == 0;
  Scene scene = read_scene(arguments.scene, arguments.overrides);
  if (processes().n > 1) scene.output.checkpoint_every = 0;  // none tells of several processes
  check_scene(scene, arguments.scene);
  check_scheme(scene, arguments.scene);
  std::function<bool(bool)> of_first;
  if (processes().n > 1 && arguments.budget)
    of_first = [](bool decided) { return from_first_process(static_cast<int>(decided)) != 0; };
  Session session("fem_reference", arguments, scene, is_first, of_first);
  if (const std::string part = unmodelled_part(scene); !part.empty()) return session.refuse(part);
  const std::string options =
      std::to_string(arguments.n_levels) + ' ' + std::to_string(arguments.n_frequencies);
  const auto status = session.stored_status({"network"}, options);
  if (from_first_process(status.has_value())) return status.value_or(kSolved);
  if (processes().n > 1 && from_first_process(session.saved_simulation() != nullptr))
    throw std::runtime_error(
        arguments.out + ": a run was stopped there, expected the one process that it began with, or --force");

  session.start("mesh");
  TetReport attempts;
  TetMesh mesh;  // of the first process
  int n_tetrahedra = 0;
  const SurfaceMesh surface = session.cut_surface([&](const SurfaceMesh& cut) {
    constexpr int kRefused = 0, kLate = -1;  // where the first has none, no process has
    int found = kRefused;
    std::string refused;
    try {
      mesh = is_first ? fill(cut, scene, attempts) : TetMesh();
      found = static_cast<int>(mesh.T.cols());
    } catch (const std::runtime_error& error) {
      refused = error.what();
      if (dynamic_cast<const meshing::OutOfTime*>(&error)) found = kLate;
    }
    n_tetrahedra = from_first_process(found);
    if (n_tetrahedra == kLate) throw meshing::OutOfTime(refused);
    if (n_tetrahedra == kRefused) throw std::runtime_error(refused);
  });
  const bool is_implicit =
      scene.time.mode == TimeMode::Dynamic && !find_scheme(scene.reference.integrator).is_explicit();
  const Memory kind = is_implicit && law_of(scene) != MaterialLaw::SmallStrain ? Memory::FactorAndCopy
                      : is_implicit || scene.material.damping_ratio > 0 || arguments.n_frequencies > 0
                          ? Memory::Factor
                          : Memory::Iterations;
  check_memory(n_tetrahedra, scene.reference.refine + std::max(0, arguments.n_levels - 1),
               scene.reference.degree, kind, memory_available(), processes());

  session.start("setup");
  Simulation simulation(scene, surface, mesh, session.timer);
  session.timer.stop();
  // The surface as it was cut, refined or not, so that every run of it can be compared vertex by vertex.
  const int vtk_type = scene.reference.degree == 1 ? 10 : 24;
  const ElasticSolid& solid = simulation.solid();
  session.open(simulation.X(), surface, {{vtk_type, simulation.written_cells()}}, processes().n_threads,
               {processes().n, processes().rank, simulation.written_nodes()});
  from_first_process(0);  // it has emptied the folder
  session.record.update(to_json(attempts));
  if (is_first) session.record["tetrahedra"] = to_json(tet_quality(mesh.X, mesh.T));
  describe(simulation, scene, session.record);
  session.foresee(solid.n_nodes(), foreseen_seconds(simulation, scene));
  take_steps(simulation, session);
  report(simulation, scene, session.record);
  if (arguments.n_levels > 0 && scene.time.mode == TimeMode::Static && simulation.status() == Status::Ok)
    session.record["convergence"] = study_convergence(session, surface, mesh, arguments.n_levels);
  if (arguments.n_frequencies > 0)
    add_frequencies(solid, scene.reference.mass, arguments.n_frequencies, session.record);
  report_processes(session);
  return session.finish();
}

}  // namespace
}  // namespace testbed::fem

int main(int argc, char** argv) {
  using namespace testbed;
  fem::Arguments arguments;
  arguments.out = "out/fem_reference";
  CLI::App app(
      "Solves a scene by finite elements on tetrahedra of the same surface: the reference.\n\n"
      "Examples:\n"
      "  fem_reference analysis/scenes/ball_pressure.toml\n"
      "  fem_reference scene.toml --set reference.degree=1 --set reference.refine=1 --out out/linear\n"
      "  fem_reference scene.toml --converge 2\n"
      "  mpirun -np 8 fem_reference scene.toml        (statics and motion)\n");
  app.add_option(
         "--converge", arguments.n_levels,
         "also solve on this many meshes, each refined once more, and write the estimated error of the "
         "result into run.json")
      ->check(CLI::Range(2, 6));
  return run_program(app, argc, argv, arguments, [&] {
    try {
      return fem::run(arguments);
    } catch (const std::exception& error) {
      if (fem::processes().n > 1) fem::abort_processes(error.what());
      throw;
    }
  });
}
