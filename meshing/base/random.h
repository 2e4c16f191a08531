// The project's one random stream: the same numbers on every machine.
#pragma once

#include <cstdint>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// SplitMix64 [Steele, Lea & Flood 2014].
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t bits() {
    std::uint64_t z = (state_ += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }

  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(bits() >> 11) * 0x1p-53; }

  /// Uniform in 0 ... n - 1, n < 2^32 (multiply and shift; the bias is below n/2^32).
  std::uint64_t below(std::uint64_t n) { return (bits() >> 32) * n >> 32; }

 private:
  std::uint64_t state_;
};

}  // namespace testbed::meshing
