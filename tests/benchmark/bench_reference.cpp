// The reference program in whole, from scene to files: beside CalculiX on the same tetrahedra, at a million
// unknowns, and its start; and a step in time. Seconds of a program count those of the programs that it
// starts.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <chrono>
#include <nlohmann/json.hpp>

#include "fem_reference/solid/dynamics.h"
#include "fem_reference/solid/problem.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/fem_reference/calculix.h"

namespace {

using namespace testbed;
using namespace testbed::fem;
using Words = std::vector<std::string>;

struct Cost {
  double cpu, wall;  ///< s
};

/// CPU seconds of all child processes that have ended.
double cpu_of_children() {
  rusage usage;
  getrusage(RUSAGE_CHILDREN, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

template <class Run>
Cost cost(const Run& run) {
  const double cpu = cpu_of_children();
  const auto start = std::chrono::steady_clock::now();
  run();
  return {cpu_of_children() - cpu,
          std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()};
}

constexpr double kTimeLimit = 3600;  // s
const std::string kScenes = SCENE_FOLDER;

/// A body of a shape held at one end under its weight, or (ball under pressure) free.
struct Case {
  std::string scene;
  Words sets;
  Case(const std::string& name, const std::string& shape, int n_vertices, int degree)
      : scene(kScenes + "/" + name + ".toml"),
        sets{"surface.shape=" + shape, "surface.n_vertices=" + std::to_string(n_vertices),
             "reference.degree=" + std::to_string(degree), "load_scale.factor=1"} {}
};

/// Runs our program. @returns its run.json
nlohmann::json run_reference(const Case& at) {
  const TemporaryFolder folder;
  Words arguments{at.scene, "--quiet", "--out", folder.path()};
  for (const std::string& set : at.sets) arguments.insert(arguments.end(), {"--set", set});
  const ChildResult child = run_child(program_folder() / "fem_reference", arguments, kTimeLimit);
  if (!child.is_success) throw std::runtime_error(child.output);
  return nlohmann::json::parse(read_file(folder.path() / "run.json"));
}

/// Both in turn, so that what else the machine does befalls both. CalculiX is given the tetrahedra; what ours
/// takes to make them is shown and left out of the ratios.
void against_calculix(benchmark::State& bench, const Case& at) {
  if (!has_calculix()) return bench.SkipWithError("ccx is not installed (Debian package calculix-ccx)");
  const Scene scene = read_scene(at.scene, at.sets);
  const SurfaceMesh surface = load_surface(scene.surface);
  const ElasticSolid solid = assemble_scene(scene, surface, tetrahedralize(surface));
  const TemporaryFolder folder;
  CalculixJob job;
  job.material = scene.material;
  job.held = solid.held();
  job.gravity = *scene.gravity;
  write_file(folder.path() / "job.inp", calculix_input(solid, job));
  const auto calculix = [&] {
    const ChildResult child =
        run_child("/usr/bin/env", {"-C", folder.path(), "ccx", "-i", "job"}, kTimeLimit);
    if (!child.is_success) throw std::runtime_error(child.output);
  };
  for (auto _ : bench) {
    const Cost mesh = cost([&] { tetrahedralize(surface); }), ours = cost([&] { run_reference(at); }),
               theirs = cost(calculix);
    bench.SetIterationTime(ours.wall);
    bench.counters["dofs"] = solid.n_dofs();
    bench.counters["cpu"] = ours.cpu;
    bench.counters["mesh_cpu"] = mesh.cpu;
    bench.counters["ccx_cpu"] = theirs.cpu;
    bench.counters["ratio_cpu"] = theirs.cpu / (ours.cpu - mesh.cpu);
    bench.counters["ratio_wall"] = theirs.wall / (ours.wall - mesh.wall);
  }
}

/// From scene to files, stage by stage.
void whole(benchmark::State& bench, const Case& at) {
  for (auto _ : bench) {
    nlohmann::json record;
    const Cost ours = cost([&] { record = run_reference(at); });
    bench.SetIterationTime(ours.wall);
    bench.counters["cpu"] = ours.cpu;
    bench.counters["dofs"] = record["n_dofs"];
    bench.counters["tetrahedra"] = record["n_tetrahedra"];
    bench.counters["GiB"] = record["peak_memory"].get<double>() / (1 << 30);
    for (const auto& [stage, seconds] : record["seconds"].items()) bench.counters[stage] = seconds;
  }
}

/// What loading the libraries costs: --help does nothing else.
void load(benchmark::State& bench) {
  for (auto _ : bench)
    bench.SetIterationTime(
        cost([] { run_child(program_folder() / "fem_reference", {"--help"}, kTimeLimit); }).cpu);
}

/// A Newmark step of a swinging bar.
void newmark_step(benchmark::State& bench, const Case& at) {
  const Scene scene = read_scene(at.scene, at.sets);
  const SurfaceMesh surface = load_surface(scene.surface);
  const ElasticSolid solid = assemble_scene(scene, surface, tetrahedralize(surface));
  Dynamics system;
  system.K = solid.stiffness();
  system.M = solid.mass();
  system.load = solid.load();
  for (const HeldComponent& h : solid.held()) system.held.push_back(3 * h.node + h.component);
  TimeIntegrator motion(std::move(system), 1e-4, kNewmark);
  for (auto _ : bench) motion.step();
  bench.counters["dofs"] = solid.n_dofs();
}

}  // namespace

int main(int argc, char** argv) {
  const auto once = [](const std::string& name, auto function, const Case& at) {
    benchmark::RegisterBenchmark(name.c_str(), function, at)
        ->Iterations(1)
        ->UseManualTime()
        ->Unit(benchmark::kSecond);
  };
  once("calculix/bar/25k/degree:1", against_calculix, {"bar_sag", "bar", 3650, 1});
  once("calculix/bar/25k/degree:2", against_calculix, {"bar_sag", "bar", 890, 2});
  once("calculix/bar/180k/degree:1", against_calculix, {"bar_sag", "bar", 21000, 1});
  once("calculix/bar/180k/degree:2", against_calculix, {"bar_sag", "bar", 3650, 2});
  once("calculix/ball/180k/degree:1", against_calculix, {"sag", "ball", 16000, 1});
  once("calculix/ball/180k/degree:2", against_calculix, {"sag", "ball", 2900, 2});
  once("whole/ball/1.17M/degree:2", whole, {"ball_pressure", "ball", 15900, 2});
  once("whole/smallest", whole, {"ball_pressure", "ball", 12, 2});
  benchmark::RegisterBenchmark("newmark_step/24k/degree:1", newmark_step, Case("bar_sag", "bar", 3500, 1))
      ->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark("load", load)->UseManualTime()->Unit(benchmark::kMillisecond);
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
}
