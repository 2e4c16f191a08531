// Whether a problem fits into the machine, before hours are lost on it.
#pragma once

#include <cstdint>

#include "fem_reference/base/processes.h"

namespace testbed::fem {

/// What a solution is found by: iterations hold the matrix alone, a Cholesky factor (steps in time, natural
/// frequencies) holds far more. Steps at large strain have a copy of it in single precision besides.
enum class Memory { Iterations, Factor, FactorAndCopy };

/// Bytes that a mesh of tetrahedra takes at most on this machine, by figures measured on balls (analysis/RESULTS.md, 9).
double memory_needed(double n_tetrahedra, int degree, Memory kind, const Processes& = {});

/// Free memory of the machine or of the container that holds us (byte).
double memory_available();

/// @param n_tetrahedra  before they are split in eight `refine` times
/// @throws std::runtime_error when it does not fit: names what does.
void check_memory(std::int64_t n_tetrahedra, int refine, int degree, Memory kind, double available,
                  const Processes& processes = {});

}  // namespace testbed::fem
