// Times of the meshing library on one core:
//   bench_meshing --benchmark_filter='whole'          sampling, PCP and completion
// Lemma 1 [paper 4.3]: blocks_per_node, the non-zero 3 x 3 blocks of the system matrix over n + k, stays
// constant.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "meshing/base/kd_tree.h"
#include "meshing/network/connect.h"
#include "meshing/surface/shapes.h"

using namespace testbed::meshing;

namespace {

/// A ball whose surface is as finely divided as its inside with n nodes.
SurfaceMesh ball_for(double n) {
  const double spacing = std::cbrt(4.19 / n);
  return make_shape("ball", static_cast<int>(12.57 / (0.866 * spacing * spacing)));
}

SampleOptions options_for(int n) {
  SampleOptions options;
  options.k = n;
  options.phi =
      std::cbrt(0.5 * 4.19 / n) / 2;  // saturated darts would give 0.64 instead of 0.5 nodes per phi^3
  options.psi = *options.phi / 2;
  return options;
}

void sample(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  const SurfaceMesh surface = ball_for(n);
  long found = 0;
  for (auto _ : state) found = sample_interior(surface, options_for(n)).cols();
  state.counters["nodes"] = static_cast<double>(found);
  state.SetComplexityN(n);
}

void link(benchmark::State& state, Connectivity connectivity) {
  const int n = static_cast<int>(state.range(0));
  const SurfaceMesh surface = ball_for(n);
  const Eigen::Matrix3Xd interior = sample_interior(surface, options_for(n));
  ConnectOptions options;
  options.connectivity = connectivity;
  SpringNetwork network;
  for (auto _ : state) network = connect(surface, interior, options);
  state.counters["blocks_per_node"] = 1 + 2.0 * network.E.cols() / network.X.cols();
  state.SetComplexityN(n);
}

void whole(benchmark::State& state) {
  const int n = static_cast<int>(state.range(0));
  const SurfaceMesh surface = ball_for(n);
  ConnectOptions options;
  options.connectivity = Connectivity::CompletedPcp;
  for (auto _ : state)
    benchmark::DoNotOptimize(connect(surface, sample_interior(surface, options_for(n)), options));
  state.SetComplexityN(n);
}

/// Eight nearest neighbours of every node.
void neighbours(benchmark::State& state, bool is_brute_force) {
  const int n = static_cast<int>(state.range(0));
  const Eigen::Matrix3Xd X = sample_interior(ball_for(n), options_for(n));
  for (auto _ : state) {
    if (is_brute_force) {
      for (const auto& x : X.colwise()) {
        std::vector<double> distances(X.cols());
        Eigen::Map<Eigen::RowVectorXd>(distances.data(), X.cols()) =
            (X.colwise() - x).colwise().squaredNorm();
        std::nth_element(distances.begin(), distances.begin() + 8, distances.end());
        benchmark::DoNotOptimize(distances);
      }
    } else {
      const KdTree tree(X);
      for (const auto& x : X.colwise()) benchmark::DoNotOptimize(tree.nearest(x, 9));
    }
  }
}

constexpr int kThousand = 1000, kMillion = 1000000;

}  // namespace

BENCHMARK(sample)
    ->RangeMultiplier(10)
    ->Range(kThousand, kMillion)
    ->Complexity()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(link, pcp, Connectivity::Pcp)
    ->RangeMultiplier(10)
    ->Range(kThousand, kMillion)
    ->Complexity()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(link, completed_pcp, Connectivity::CompletedPcp)
    ->RangeMultiplier(10)
    ->Range(kThousand, kMillion)
    ->Complexity()
    ->Unit(benchmark::kMillisecond);
BENCHMARK(whole)
    ->RangeMultiplier(10)
    ->Range(kThousand, kMillion)
    ->Complexity()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(neighbours, k_d_tree, false)
    ->Arg(kThousand)
    ->Arg(10 * kThousand)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(neighbours, brute_force, true)
    ->Arg(kThousand)
    ->Arg(10 * kThousand)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_MAIN();
