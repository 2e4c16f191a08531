// The reference program in whole, from scene to files: beside CalculiX on the same tetrahedra, at a million
// unknowns, and its start; a step in time, and what batches of elements take. Seconds of a program count those of the programs that it
// starts.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <chrono>
#include <ctime>
#include <nlohmann/json.hpp>

#include "fem_reference/elements/tet_batches.h"
#include "fem_reference/solid/central_differences.h"
#include "fem_reference/solid/problem.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/benchmark/limit.h"
#include "tests/fem_reference/calculix.h"
#include "tests/meshing/box_tets.h"

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

/// A body of a shape constrained at one end under its weight, or (ball under pressure) free.
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
  job.constrained = solid.constrained();
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
  for (const ConstrainedComponent& h : solid.constrained())
    system.constrained.push_back(3 * h.node + h.component);
  GeneralisedAlpha motion(std::move(system), 1e-4, kNewmark);
  for (auto _ : bench) motion.step();
  bench.counters["dofs"] = solid.n_dofs();
}

constexpr int kCells = 12;  // of the box, in each direction, as that of coupled springs in bench_step

/// Four points, which integrate the stiffness of degree 2, or the middle.
TetRule rule_of(int degree) {
  if (degree == 1) return {Eigen::Vector4d::Constant(0.25), Eigen::VectorXd::Ones(1)};
  const double b = (5 - std::sqrt(5)) / 20;
  TetRule rule{Eigen::Matrix4d::Constant(b), Eigen::VectorXd::Constant(4, 0.25)};
  rule.points.diagonal().setConstant(1 - 3 * b);
  return rule;
}

/// Of a tetrahedron at a point: the gradient of its displacement, by degree 2 from four derivatives (84
/// flops).
double flops_of_gradient(int degree) {
  return degree == 1 ? 54 : 138;
}

/// A point of a tetrahedron has a gradient, a stress (15 flops, neo-Hookean 74) and the forces of four
/// barycentric coordinates (64), which degree 2 divides among ten nodes (96). A node's displacement and force
/// take 6. Vectors and constants are read once, and forces written and read again.
Work work_of_forces(const TetBatches& tets, int degree, ElasticLaw law) {
  const double n = degree == 1 ? 4 : 10, n_points = degree == 1 ? 1 : 4,
               of_law = law == ElasticLaw::SmallStrain ? 15 : 74, share = degree == 1 ? 12 : 96;
  const double n_tets = tets.n_tetrahedra(), n_nodes = static_cast<double>(tets.rank().size());
  return {n_tets * (n_points * (flops_of_gradient(degree) + of_law + 64 + share) + 6 * n),
          n_tets * (80 + 4 * n) + 72 * n_nodes};
}

/// In single precision, whose flops are half as dear. A pair of nodes takes 51 flops at a point and 9 to add;
/// a point has a tangent (6 flops, neo-Hookean 60), four coordinates pushed forward (60) and, of degree 2,
/// gradients of the shape functions (132). Half the blocks are read and written.
Work work_of_tangent(const TetBatches& tets, int degree, ElasticLaw law) {
  const double n = degree == 1 ? 4 : 10, n_points = degree == 1 ? 1 : 4, n_pairs = n * (n + 1) / 2,
               of_law = law == ElasticLaw::SmallStrain ? 6 : 60, shape = degree == 1 ? 0 : 132;
  const double n_tets = tets.n_tetrahedra(), n_nodes = static_cast<double>(tets.rank().size()),
               n_blocks = static_cast<double>(tets.pattern().column.size());
  return {n_tets *
              (n_points * (flops_of_gradient(degree) + of_law + 60 + shape + 51 * n_pairs) + 9 * n_pairs) / 2,
          n_tets * (80 + 4 * n + 4 * n_pairs) + 24 * n_nodes + 36 * n_blocks};
}

/// Elements of a box, its nodes displaced at random by up to a tenth of an edge: forces, or tangents in single
/// precision.
void elements(benchmark::State& bench, bool is_tangent, int degree, ElasticLaw law) {
  const ElasticSolid solid(box_tets(kCells, kCells, kCells, 1. / kCells, 0.2), degree);
  TetBatches tets(solid.X(), solid.cells());
  tets.set_law(law, LameConstants(Material{1e5, 0.25, 1000, 0}), rule_of(degree));
  Random random(1);
  Eigen::Matrix3Xd u(3, solid.X().cols()), f;
  for (double& c : u.reshaped()) c = 0.2 / kCells * (random.uniform() - 0.5);
  std::vector<float> blocks(9 * tets.pattern().column.size() + 3);
  const std::clock_t begin = std::clock();
  for (auto _ : bench) {
    if (is_tangent)
      tets.add_tangent(u, blocks.data());
    else
      tets.forces(u, f);
    benchmark::DoNotOptimize(blocks.data());
    benchmark::DoNotOptimize(f.data());
  }
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  report_limit(bench, is_tangent ? work_of_tangent(tets, degree, law) : work_of_forces(tets, degree, law),
               seconds);
  bench.counters["ns_per_tetrahedron"] =
      1e9 * seconds / static_cast<double>(bench.iterations()) / tets.n_tetrahedra();
}

/// Explicit steps of the box, which hangs on one of its faces, at small strain.
void explicit_step(benchmark::State& bench, int degree) {
  ElasticSolid solid(box_tets(kCells, kCells, kCells, 1. / kCells, 0.2), degree);
  std::vector<ConstrainedComponent> clamp;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3 && solid.X()(2, i) > 1 - 0.3 / kCells; ++c) clamp.push_back({i, c, 0});
  ElasticLoads gravity;
  gravity.body_force = [](const Eigen::Vector3d&) { return Eigen::Vector3d(0, 0, -9810); };
  solid.assemble(Material{1e5, 0.25, 1000, 0}, ElasticLaw::SmallStrain, gravity, clamp);
  Dynamics system;
  system.K = solid.stiffness();
  system.M = solid.mass(MassMatrix::Lumped);
  system.load = solid.load();
  for (const ConstrainedComponent& h : clamp) system.constrained.push_back(3 * h.node + h.component);
  system.forces = [&](const Eigen::VectorXd& u, Eigen::Matrix3Xd& f) {
    solid.find_forces(u.reshaped(3, solid.X().cols()), 1, f);
  };
  const double h = 0.5 * stable_step(system);
  CentralDifferences motion(std::move(system), h);
  const std::clock_t begin = std::clock();
  for (auto _ : bench)
    if (!motion.step()) bench.SkipWithError("no step");
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  // A component's two velocities, its position and its acceleration: 9 flops. Eleven vectors are read or
  // written.
  Work work = work_of_forces(TetBatches(solid.X(), solid.cells()), degree, ElasticLaw::SmallStrain);
  work.flops += 9. * solid.n_dofs();
  work.bytes += 88. * solid.n_dofs();
  report_limit(bench, work, seconds);
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
  for (const int degree : {1, 2}) {
    const std::string of_degree = "/degree:" + std::to_string(degree);
    for (const bool is_tangent : {false, true})
      for (const ElasticLaw law : {ElasticLaw::SmallStrain, ElasticLaw::NeoHookean})
        benchmark::RegisterBenchmark(
            (std::string("elements/") + (is_tangent ? "tangent" : "forces") +
             (law == ElasticLaw::SmallStrain ? "/small_strain" : "/neo_hookean") + of_degree)
                .c_str(),
            elements, is_tangent, degree, law)
            ->Unit(benchmark::kMicrosecond);
    benchmark::RegisterBenchmark(("elements/explicit_step" + of_degree).c_str(), explicit_step, degree)
        ->Unit(benchmark::kMicrosecond);
  }
  benchmark::RegisterBenchmark("load", load)->UseManualTime()->Unit(benchmark::kMillisecond);
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
}
