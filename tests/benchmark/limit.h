// What a kernel takes beside what this machine lets it take.
#pragma once

#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <algorithm>
#include <ctime>
#include <limits>

#include "meshing/algebra/vectors.h"

namespace testbed {

/// Smallest CPU time (s) of a few calls.
template <class Work>
TESTBED_INLINE inline double shortest(const Work& work) {
  double least = std::numeric_limits<double>::infinity();
  for (int n = 0; n < 7; ++n) {
    const std::clock_t begin = std::clock();
    work();
    least = std::min(least, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return least;
}

/// Multiplications and additions in a second, of sums that stay in the widest registers.
inline double flop_rate() {
  static const double kRate = [] {
    constexpr int kTimes = 1000000, kSums = 12;  // enough of them that none waits for the one before
    double result = 0;
    by_width([&](auto width) TESTBED_INLINE {
      typename Lanes<width>::Vector sum[kSums], factor{}, term{};
      factor = factor + 0.5;
      term = term + 1.;
      for (auto& s : sum) s = term;
      const double time = shortest([&]() TESTBED_INLINE {
        for (int n = 0; n < kTimes; ++n)
          for (auto& s : sum) s = s * factor + term;
      });
      for (auto& s : sum) benchmark::DoNotOptimize(*reinterpret_cast<double*>(&s));
      result = 2. * width * kSums * kTimes / time;
    });
    return result;
  }();
  return kRate;
}

/// Bytes in a second that a = b + s c moves over so many bytes: those that fit a cache come from there.
inline double bandwidth(double bytes) {
  const auto n = static_cast<Eigen::Index>(bytes / 24);
  const auto n_times = static_cast<int>(1 + 1e8 / bytes);
  Eigen::VectorXd a(n), b = Eigen::VectorXd::Random(n), c = Eigen::VectorXd::Random(n);
  return bytes * n_times / shortest([&] {
           for (int k = 0; k < n_times; ++k) {
             a = b + 1.1 * c;
             benchmark::DoNotOptimize(a.data());
           }
         });
}

/// What a kernel has to do. Its limit is the longer of the times that its flops and its bytes take at the
/// machine's rates.
struct Work {
  double flops, bytes;
};

/// @param seconds  of CPU, of all iterations
inline void report_limit(benchmark::State& bench, const Work& work, double seconds) {
  const double limit = std::max(work.flops / flop_rate(), work.bytes / bandwidth(work.bytes));
  bench.counters["flops"] = work.flops;
  bench.counters["bytes"] = work.bytes;
  bench.counters["limit_s"] = limit;
  bench.counters["over_limit"] = seconds / static_cast<double>(bench.iterations()) / limit;
}

}  // namespace testbed
