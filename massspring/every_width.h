// Kernels built for several vector widths. Without contraction (CMakeLists.txt) each gives the same bits.
#pragma once

#define TESTBED_EVERY_WIDTH __attribute__((target_clones("avx512f", "avx2", "default")))

/// Lanes x y z 0 of four nodes as y z x 0 and as z x y 0.
#define TESTBED_TURNED_LEFT(u) \
  __builtin_shufflevector(u, u, 1, 2, 0, 3, 5, 6, 4, 7, 9, 10, 8, 11, 13, 14, 12, 15)
#define TESTBED_TURNED_RIGHT(u) \
  __builtin_shufflevector(u, u, 2, 0, 1, 3, 6, 4, 5, 7, 10, 8, 9, 11, 14, 12, 13, 15)
