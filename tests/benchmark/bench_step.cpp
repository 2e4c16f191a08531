// Time per step on the four models of the paper's Table 1: its node counts, 500 internal nodes, its
// multiplicities, gravity and a global volume force, held at the nodes of its lowest fifth. Velocities are
// damped: undamped, a limp body swings without end through itself, and where a spring shrinks to a point the
// direction of Hooke's force flips, which no fixed step follows: symplectic Euler gains energy at half its
// stability limit, and none at a fifth of that.
#include <benchmark/benchmark.h>

#include "massspring/calibrate.h"
#include "massspring/integrators.h"
#include "meshing/network.h"
#include "meshing/shapes.h"

namespace {

using namespace testbed;

struct Table1 {
  const char* shape;
  int n_surface, multiplicity;
  double explicit_fps, implicit_fps;  // as published
};
const Table1 kModels[]{{"ball", 162, 5, 33.25, 1.42},
                       {"torus", 924, 5, 12.51, 0.50},
                       {"handle", 932, 3, 16.62, 0.66},
                       {"head", 3897, 3, 5.14, 0.23}};
constexpr double kSoft = 1e5, kStiff = 1e8;  // Pa; the soft ones sag by a good part of their height

MassSpringModel make_model(const Table1& row, double E) {
  const SurfaceMesh surface = make_shape(row.shape, row.n_surface);
  SampleOptions sampling;
  sampling.k = 500;
  sampling.phi = sampling.psi = 0.02;
  Material material;
  material.E = E;
  return calibrate(link_pcp(surface, sample_interior(surface, sampling), {row.multiplicity}), material,
                   find_calibration("uniform"));
}

Forces make_forces(const MassSpringModel& model) {
  Forces forces;
  forces.load = Eigen::Vector3d(0, 0, -9.81) * model.mass.transpose();
  forces.volume_pressure = model.material.E;
  forces.mass_damping = 1;
  const auto z = model.network.X.row(2);
  const double floor = z.minCoeff() + 0.2 * (z.maxCoeff() - z.minCoeff());
  for (int i = 0; i < z.cols(); ++i)
    if (z(i) <= floor) forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  return forces;
}

void step(benchmark::State& bench, const Table1& row, double E, Integrator integrator) {
  const MassSpringModel model = make_model(row, E);
  const Forces forces = make_forces(model);
  State state = initial_state(model);
  constexpr double kTolerance = 1e-4, kFrame = 1. / 60;
  const double h = is_explicit(integrator) ? 0.5 * stable_step(model, forces, state) : kFrame;
  TimeStepper stepper(model, forces, integrator, 1, {kTolerance});
  double linear_iterations = 0;
  for (auto _ : bench) {
    const StepReport report = stepper.step(state, h);
    if (report.status != Status::Ok) bench.SkipWithError(name_of(report.status));
    linear_iterations += report.linear_iterations;
  }
  const auto n_steps = static_cast<double>(bench.iterations());
  bench.counters["FPS"] = benchmark::Counter(n_steps, benchmark::Counter::kIsRate);
  bench.counters["paper_FPS"] = is_explicit(integrator) ? row.explicit_fps : row.implicit_fps;
  bench.counters["springs_per_s"] =
      benchmark::Counter(n_steps * static_cast<double>(model.network.E.cols()), benchmark::Counter::kIsRate);
  bench.counters["nodes"] = static_cast<double>(model.network.X.cols());
  bench.counters["springs"] = static_cast<double>(model.network.E.cols());
  bench.counters["cg_iterations"] = linear_iterations / n_steps;
}

}  // namespace

int main(int argc, char** argv) {
  for (const Table1& row : kModels)
    for (const auto& [integrator, name] : {std::pair(Integrator::SymplecticEuler, "symplectic_euler"),
                                           std::pair(Integrator::ImplicitEuler, "implicit_euler"),
                                           std::pair(Integrator::MinimisingEuler, "minimising_euler")})
      for (const double E : {kSoft, kStiff}) {
        if (is_explicit(integrator) && E == kStiff) continue;  // the same work
        const std::string label = std::string(row.shape) + "/" + name + (E == kSoft ? "/soft" : "/stiff");
        benchmark::RegisterBenchmark(label.c_str(), step, row, E, integrator);
      }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
