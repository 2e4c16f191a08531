// Kernels built for several vector widths. Without contraction (CMakeLists.txt) each gives the same bits.
#pragma once

#define TESTBED_EVERY_WIDTH __attribute__((target_clones("avx512f", "avx2", "default")))
