// Time per step on the four models of the paper's Table 1: its node counts, 500 internal nodes, its
// multiplicities, gravity, a global volume force and a floor that they stand on. Velocities are damped:
// undamped, a limp body swings without end through itself, and where a spring shrinks to a point the
// direction of Hooke's force flips, which no fixed step follows: symplectic Euler gains energy at half its
// stability limit, and none at a fifth of that.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>

#include "massspring/model/small_strain.h"
#include "massspring/statics/linear_statics.h"
#include "massspring/statics/quasi_static.h"
#include "massspring/time/implicit_matrix.h"
#include "massspring/time/integrators.h"
#include "meshing/algebra/vectors.h"
#include "tests/benchmark/limit.h"
#include "tests/benchmark/table_1.h"
#include "tests/meshing/box_tets.h"

namespace {

using namespace testbed;
using namespace testbed::massspring;

constexpr double kSoft = 1e5, kStiff = 1e8;  // Pa; the soft ones sag by a good part of their height
constexpr int kWarmUp = 3;                   // steps after which bodies stand and solvers are chosen

Forces make_forces(const MassSpringModel& model) {
  Forces forces;
  forces.load = Eigen::Vector3d(0, 0, -9.81) * model.mass.transpose();
  add_volume_penalty(model.material.E, model, forces);
  forces.mass_damping = 1;
  return forces;
}

Contacts make_floor(const MassSpringModel& model) {
  Obstacle floor;
  floor.shape = HalfSpace{{0, 0, model.network.X.row(2).minCoeff()}, {0, 0, 1}};
  floor.friction = 0.5;
  Contacts contacts;
  contacts.bodies.emplace_back(floor);
  return contacts;
}

void step(benchmark::State& bench, const Table1& row, double E, const std::string& integrator) {
  const MassSpringModel model = make_model(row, E);
  const Forces forces = make_forces(model);
  const Contacts floor = make_floor(model);
  State state = initial_state(model);
  constexpr double kTolerance = 1e-4, kFrame = 1. / 60;
  // Explicit Euler gains energy in steps of any length, in short ones little while it is timed.
  const double part = integrator == "explicit_euler" ? 0.01 : 0.5;
  const double h =
      find_integrator(integrator).is_explicit ? part * stable_step(model, forces, state) : kFrame;
  TimeStepper stepper(model, forces, integrator, 1, {kTolerance}, floor);
  for (int n = 0; n < kWarmUp; ++n) stepper.step(state, h);
  double linear_iterations = 0;
  for (auto _ : bench) {
    const StepReport report = stepper.step(state, h);
    if (report.status != Status::Ok) bench.SkipWithError(name_of(report.status));
    linear_iterations += report.linear_iterations;
  }
  const auto n_steps = static_cast<double>(bench.iterations());
  bench.counters["FPS"] = benchmark::Counter(n_steps, benchmark::Counter::kIsRate);
  bench.counters["paper_FPS"] = find_integrator(integrator).is_explicit ? row.explicit_fps : row.implicit_fps;
  bench.counters["springs_per_s"] =
      benchmark::Counter(n_steps * static_cast<double>(model.springs->E.cols()), benchmark::Counter::kIsRate);
  bench.counters["nodes"] = static_cast<double>(model.network.X.cols());
  bench.counters["springs"] = static_cast<double>(model.springs->E.cols());
  bench.counters["cg_iterations"] = linear_iterations / n_steps;
}

/// A ball whose surface is as finely divided as its inside with about n nodes.
MassSpringModel make_ball(int n, double E) {
  const double spacing = std::cbrt(4.19 / n);
  const SurfaceMesh surface = make_shape("ball", static_cast<int>(12.57 / (0.866 * spacing * spacing)));
  SampleOptions sampling;
  sampling.k = n;
  sampling.phi = std::cbrt(0.5 * 4.19 / n) / 2;
  sampling.psi = *sampling.phi / 2;
  Material material;
  material.E = E;
  return calibrate(link_pcp(surface, sample_interior(surface, sampling), {}), material,
                   find_calibration("uniform"));
}

/// Time per step over the number of nodes, the same body and step for every size.
void scale(benchmark::State& bench, int n, double E, const std::string& integrator) {
  const MassSpringModel model = make_ball(n, E);
  const Forces forces = make_forces(model);
  const Contacts floor = make_floor(model);
  State state = initial_state(model);
  constexpr double kFrame = 1. / 60, kShort = 1e-5;
  const double h = find_integrator(integrator).is_explicit ? kShort : kFrame;
  TimeStepper stepper(model, forces, integrator, 1, {1e-4}, floor);
  for (int n = 0; n < kWarmUp; ++n) stepper.step(state, h);
  double linear_iterations = 0;
  for (auto _ : bench) linear_iterations += stepper.step(state, h).linear_iterations;
  const auto n_nodes = static_cast<double>(model.network.X.cols());
  const auto n_steps = static_cast<double>(bench.iterations());
  bench.counters["nodes"] = n_nodes;
  bench.counters["ns_per_node"] =
      benchmark::Counter(n_steps * n_nodes * 1e-9, benchmark::Counter::kIsRate | benchmark::Counter::kInvert);
  bench.counters["cg_iterations"] = linear_iterations / n_steps;
}

/// Set-up and solve of a clamped bar of tetrahedra, twice as long as wide, under its weight at small strain.
void scale_statics(benchmark::State& bench, int n_cells) {
  const TetMesh mesh = box_tets(2 * n_cells, n_cells, n_cells, 1. / n_cells, 0.2);
  Material material;
  material.E = kStiff;
  double set_up = 0;
  int iterations = 0;
  for (auto _ : bench) {
    const std::clock_t begin = std::clock();
    MassSpringModel model = calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface},
                                      material, find_calibration("node_averaged"));
    model.consistent_mass = consistent_mass(mesh.X, mesh.T, material.rho);
    linearise(model);
    Forces forces;
    forces.load = Eigen::Vector3d(0, 0, -9.81) * model.mass.transpose();
    for (int i = 0; i < mesh.X.cols(); ++i)
      if (mesh.X(0, i) < 0.3 / n_cells)
        forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
    State state = initial_state(model);
    QuasiStaticSolver solver(model, forces, 1e-10);
    set_up = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
    const StepReport report = solver.solve(1, state);
    if (report.status != Status::Ok) bench.SkipWithError(name_of(report.status));
    iterations = report.linear_iterations;
  }
  bench.counters["nodes"] = static_cast<double>(mesh.X.cols());
  bench.counters["set_up_s"] = set_up;
  bench.counters["cg_iterations"] = iterations;
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  bench.counters["peak_MB"] = static_cast<double>(usage.ru_maxrss) / 1e3;  // of the largest so far
}

/// The kernels on the head, warm: springs' forces, and K p spring by spring and by blocks.
void kernel(benchmark::State& bench, const std::string& name) {
  const MassSpringModel model = make_model(kModels[3], kSoft);
  State state = initial_state(model);
  state.x *= 1.1;
  const Springs& springs = *model.springs;
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, state, K);
  const SpringBlocks B = hessian(springs, state.rest_length, state.x);
  const Eigen::Matrix3Xd p = state.x;
  Eigen::Matrix3Xd y = p;
  const auto n_springs = static_cast<double>(springs.E.cols()), n_nodes = static_cast<double>(p.cols());
  double bytes = 0;  // that a step must move: constant data once, node vectors once read and once written
  for (auto _ : bench) {
    if (name == "forces") {
      add_forces(springs, state.rest_length, p, y);
      bytes = n_springs * 24 + n_nodes * 72;
    } else if (name == "springs_product") {
      add_product(springs, B, p, y);
      bytes = n_springs * 40 + n_nodes * 72;
    } else {
      multiply(K, p, y);
      bytes = static_cast<double>(K.block.size()) * 76 + n_nodes * 48;
    }
    benchmark::DoNotOptimize(y.data());
  }
  const auto n = static_cast<double>(bench.iterations());
  bench.counters["GB/s"] = benchmark::Counter(n * bytes * 1e-9, benchmark::Counter::kIsRate);
  bench.counters["springs_per_s"] = benchmark::Counter(n * n_springs, benchmark::Counter::kIsRate);
}

void rates(benchmark::State& bench) {
  for (auto _ : bench) benchmark::DoNotOptimize(flop_rate());
  bench.counters["flops_per_s"] = flop_rate();
  for (const double bytes : {3e4, 3e5, 3e6, 3e7, 3e8})
    bench.counters["bytes_per_s_of_" + std::to_string(static_cast<int>(bytes / 1e3)) + "_kB"] =
        bandwidth(bytes);
}

/// Forces of coupled springs. A node of a patch takes part in F (18 flops) and takes a force (18); a patch's
/// cofactors, determinant, law and stress are 74. Vectors and constants are read once, node vectors twice and
/// written once.
Work work_of_forces(const TetSprings& springs) {
  const auto n_entries = static_cast<double>(springs.node.size()), n_patches = springs.n_patches() * 1.,
             n_nodes = 1. + *std::max_element(springs.node.begin(), springs.node.end());
  return {36 * n_entries + 74 * n_patches, 28 * n_entries + 16 * n_patches + 72 * n_nodes};
}

/// Hessians of coupled springs. A node of a patch takes part in F (18 flops) and in rows and columns (54), a
/// pair of its nodes has 46; cofactors and law are 36. Places are read once; half the blocks are read and
/// written, and mirrored.
Work work_of_hessians(const TetSprings& springs, const BlockMatrix& K) {
  const auto n_entries = static_cast<double>(springs.node.size()), n_patches = springs.n_patches() * 1.,
             n_blocks = static_cast<double>(K.block.size());
  double n_pairs = 0;
  for (int p = 0; p < springs.n_patches(); ++p) {
    const double n = springs.first[p + 1] - springs.first[p];
    n_pairs += n * (n + 1) / 2;
  }
  return {46 * n_pairs + 72 * n_entries + 36 * n_patches,
          4 * n_pairs + 28 * n_entries + 16 * n_patches + 32. * K.rows() + 144 * n_blocks};
}

/// One implicit step's system of the head, from zero to 1e-6: our conjugate gradients spring by spring, and
/// Eigen's on the matrix formed, preconditioned by its diagonal.
void solve(benchmark::State& bench, double E, bool is_eigens) {
  const MassSpringModel model = make_model(kModels[3], E);
  Forces forces = make_forces(model);
  forces.surface.clear();
  forces.volume.reset();
  const EquationOfMotion motion(model, forces);
  const State state = initial_state(model);
  constexpr double h = 1. / 60, kTolerance = 1e-6;
  ImplicitMatrix A(motion);
  A.set(state, state.x, {1, h * h, h}, Curvature::Projected);
  Eigen::Matrix3Xd b = forces.load, x;
  filter(forces.constraints, b);
  const BlockMatrix blocks = A.system().matrix();
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < blocks.rows(); ++i)
    for (int k = blocks.row_start[i]; k < blocks.row_start[i + 1]; ++k)
      for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c)
          entries.emplace_back(3 * i + r, 3 * blocks.column[k] + c, blocks.block[k](r, c));
  Eigen::SparseMatrix<double, Eigen::RowMajor> matrix(b.size(), b.size());
  matrix.setFromTriplets(entries.begin(), entries.end());
  double iterations = 0;
  for (auto _ : bench) {
    if (is_eigens) {
      Eigen::ConjugateGradient<Eigen::SparseMatrix<double, Eigen::RowMajor>, Eigen::Lower | Eigen::Upper>
          peer;
      peer.setTolerance(kTolerance);
      peer.compute(matrix);
      benchmark::DoNotOptimize(peer.solve(b.reshaped()).eval().data());
      iterations = static_cast<double>(peer.iterations());
    } else {
      LinearSolver solver;
      x = Eigen::Matrix3Xd::Zero(3, b.cols());
      iterations = solver.solve(A.system(), b, x, kTolerance).iterations;
    }
  }
  bench.counters["cg_iterations"] = iterations;
}

/// A box of tetrahedra with coupled springs.
constexpr int kCells = 12;  // in each direction
MassSpringModel make_box(const char* model_name, double nu) {
  const TetMesh mesh = box_tets(kCells, kCells, kCells, 1. / kCells, 0.2);
  Material material;
  material.nu = nu;
  return calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface}, material,
                   find_calibration(model_name));
}

/// Coupled springs on the box, its nodes displaced at random by up to a tenth of an edge: forces, Hessians, or
/// a linear solve of the box under its weight, clamped at its bottom, with assembly and factorisation. The
/// edge-coupled ones are linear finite elements.
void coupled(benchmark::State& bench, const std::string& work, const char* model_name, double nu) {
  const MassSpringModel model = make_box(model_name, nu);
  const Eigen::Matrix3Xd& X = model.network.X;
  const Eigen::Matrix3Xd load = Eigen::Vector3d(0, 0, -9.81) * model.mass.transpose();
  std::vector<Constraint> clamp;
  for (int i = 0; i < X.cols(); ++i)
    if (X(2, i) < 0.3 / kCells) clamp.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  Eigen::Matrix3Xd u(3, X.cols());
  Random random(1);
  for (double& c : u.reshaped()) c = 0.2 / kCells * (random.uniform() - 0.5);
  Eigen::Matrix3Xd y = Eigen::Matrix3Xd::Zero(3, u.cols());
  BlockMatrix K = stiffness_pattern(model);
  int iterations = 0;
  const std::clock_t begin = std::clock();
  for (auto _ : bench) {
    if (work == "solve")
      iterations = LinearStatics(model, clamp).solve(load, y).iterations;
    else if (work == "forces")
      add_forces(*model.tet_springs, u, y);
    else
      add_hessian(*model.tet_springs, u, K, work == "exact" ? Curvature::Exact : Curvature::Projected);
    benchmark::DoNotOptimize(y.data());
    benchmark::DoNotOptimize(K.block.data());
  }
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  if (work == "forces") report_limit(bench, work_of_forces(*model.tet_springs), seconds);
  if (work == "exact") report_limit(bench, work_of_hessians(*model.tet_springs, K), seconds);
  bench.counters["cg_iterations"] = iterations;
  bench.counters["nodes"] = static_cast<double>(u.cols());
  bench.counters["patches_per_s"] = benchmark::Counter(
      static_cast<double>(bench.iterations()) * model.tet_springs->n_patches(), benchmark::Counter::kIsRate);
}

/// Explicit steps of the box, which hangs on one of its faces. They stand at six times their limit, and no order of
/// nodes brings them near it: where every patch reads and writes the same few nodes in turn, forces of
/// edge_coupled still take 0.73 of their time, those of node_averaged 0.83. The limit counts flops of fused
/// multiplications and additions. These are not fused, so that each width of register gives the same bits.
/// About half the time goes to turning node vectors to lanes and back and to finding their places.
void coupled_step(benchmark::State& bench, const char* model_name) {
  const MassSpringModel model = make_box(model_name, 0.25);
  Forces forces;
  forces.load = Eigen::Vector3d(0, 0, -9.81) * model.mass.transpose();
  for (int i = 0; i < model.mass.size(); ++i)
    if (model.network.X(2, i) > 1 - 0.3 / kCells)
      forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  State state = initial_state(model);
  const double h = 0.5 * stable_step(model, forces, state);
  TimeStepper stepper(model, forces, "symplectic_euler", 1);
  const std::clock_t begin = std::clock();
  for (auto _ : bench)
    if (stepper.step(state, h).status != Status::Ok) bench.SkipWithError("no step");
  const double seconds = static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
  // Velocities and positions: 12 flops a node; the load, the mass and both are read, both are written.
  Work work = work_of_forces(*model.tet_springs);
  work.flops += 12. * static_cast<double>(state.x.cols());
  work.bytes += 128. * static_cast<double>(state.x.cols());
  report_limit(bench, work, seconds);
}

}  // namespace

int main(int argc, char** argv) {
  for (const Table1& row : kModels)
    for (const char* integrator :
         {"explicit_euler", "symplectic_euler", "implicit_euler", "minimising_euler"})
      for (const double E : {kSoft, kStiff}) {
        if (find_integrator(integrator).is_explicit && E == kStiff) continue;  // the same work
        const std::string label =
            std::string(row.shape) + "/" + integrator + (E == kSoft ? "/soft" : "/stiff");
        benchmark::RegisterBenchmark(label.c_str(), step, row, E, integrator);
      }
  for (const char* name : {"forces", "springs_product", "block_product"})
    benchmark::RegisterBenchmark((std::string("kernel/") + name).c_str(), kernel, name);
  benchmark::RegisterBenchmark("kernel/rates", rates)->Iterations(1);
  for (const double E : {kSoft, kStiff})
    for (const bool is_eigens : {false, true})
      benchmark::RegisterBenchmark(
          (std::string("solve/") + (is_eigens ? "eigen" : "ours") + (E == kSoft ? "/soft" : "/stiff"))
              .c_str(),
          solve, E, is_eigens);
  for (const char* work : {"forces", "exact", "projected", "solve"})
    for (const double nu : {0.25, 0.45, 0.49}) {
      if (nu > 0.25 && work != std::string("solve")) continue;  // the same work
      for (const char* name : {"edge_coupled", "node_averaged"})
        benchmark::RegisterBenchmark(
            (std::string("coupled/") + work + "/" + name + "/nu:" + std::to_string(nu).substr(0, 4)).c_str(),
            coupled, work, name, nu);
    }
  for (const char* name : {"edge_coupled", "node_averaged"})
    benchmark::RegisterBenchmark((std::string("coupled/step/") + name).c_str(), coupled_step, name);
  for (const char* integrator : {"symplectic_euler", "implicit_euler"})
    for (const double E : {kSoft, kStiff})
      for (const int n : {1000, 10000, 100000, 1000000}) {
        if (find_integrator(integrator).is_explicit && E == kStiff) continue;
        const std::string label =
            "scale/" + std::string(integrator) + (E == kSoft ? "/soft/" : "/stiff/") + std::to_string(n);
        benchmark::RegisterBenchmark(label.c_str(), scale, n, E, integrator);
      }
  for (const int n_cells : {12, 25, 31, 40, 50, 63, 71, 80})  // 4e3 to 1e6 nodes
    benchmark::RegisterBenchmark(("scale/statics/" + std::to_string(n_cells)).c_str(), scale_statics, n_cells)
        ->Unit(benchmark::kSecond)
        ->Iterations(1);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
