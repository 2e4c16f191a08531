// Vectors of numbers that fill a register, and functions built for several register widths. This is all that
// depends on the compiler and the machine. Without contraction (CMakeLists.txt) every width gives the same
// bits.
#pragma once

#include "meshing/base/namespace.h"

#if defined(__GNUC__) && defined(__has_builtin) && !defined(TESTBED_PLAIN)
#if __has_builtin(__builtin_shufflevector)
#define TESTBED_HAS_VECTORS 1
#endif
#endif

#ifdef TESTBED_HAS_VECTORS

namespace testbed::meshing {
typedef double Double4 __attribute__((vector_size(32), aligned(8)));
typedef double Double8 __attribute__((vector_size(64), aligned(8)));
typedef float Float4 __attribute__((vector_size(16), aligned(4)));
typedef float Float8 __attribute__((vector_size(32), aligned(4)));
typedef float Float16 __attribute__((vector_size(64), aligned(4)));
/// At their own alignment, the only one that templates know.
typedef double AlignedDouble8 __attribute__((vector_size(64)));
typedef float AlignedFloat8 __attribute__((vector_size(32)));
inline constexpr bool kHasVectors = true;
}  // namespace testbed::meshing

/// The numbered lanes of u and, numbered on, of w.
#define TESTBED_SHUFFLED(u, w, ...) __builtin_shufflevector(u, w, __VA_ARGS__)
#define TESTBED_INLINE __attribute__((always_inline))
#define TESTBED_PREFETCH(...) __builtin_prefetch(__VA_ARGS__)

#else

namespace testbed::meshing {
/// What a compiler without vectors takes for them.
template <class Scalar, int n>
struct PlainVector {
  Scalar lane[n];

  Scalar& operator[](int i) { return lane[i]; }
  Scalar operator[](int i) const { return lane[i]; }
  template <class Operation>
  static PlainVector each(const Operation& operation) {
    PlainVector result;
    for (int i = 0; i < n; ++i) result[i] = operation(i);
    return result;
  }
  friend PlainVector operator+(PlainVector u, PlainVector w) {
    return each([&](int i) { return u[i] + w[i]; });
  }
  friend PlainVector operator-(PlainVector u, PlainVector w) {
    return each([&](int i) { return u[i] - w[i]; });
  }
  friend PlainVector operator*(PlainVector u, PlainVector w) {
    return each([&](int i) { return u[i] * w[i]; });
  }
  friend PlainVector operator/(PlainVector u, PlainVector w) {
    return each([&](int i) { return u[i] / w[i]; });
  }
  friend PlainVector operator+(PlainVector u, Scalar s) {
    return each([&](int i) { return u[i] + s; });
  }
  friend PlainVector operator*(PlainVector u, Scalar s) {
    return each([&](int i) { return u[i] * s; });
  }
  friend PlainVector operator*(Scalar s, PlainVector u) { return u * s; }
  PlainVector& operator+=(PlainVector w) { return *this = *this + w; }
  PlainVector& operator-=(PlainVector w) { return *this = *this - w; }
};

template <int... places, class Scalar, int n>
PlainVector<Scalar, sizeof...(places)> shuffled(PlainVector<Scalar, n> u, PlainVector<Scalar, n> w) {
  return {(places < n ? u[places % n] : w[places % n])...};
}

using Double4 = PlainVector<double, 4>;
using Double8 = PlainVector<double, 8>;
using Float4 = PlainVector<float, 4>;
using Float8 = PlainVector<float, 8>;
using Float16 = PlainVector<float, 16>;
using AlignedDouble8 = Double8;
using AlignedFloat8 = Float8;
inline constexpr bool kHasVectors = false;
}  // namespace testbed::meshing

#define TESTBED_SHUFFLED(u, w, ...) shuffled<__VA_ARGS__>(u, w)
#define TESTBED_INLINE
#define TESTBED_PREFETCH(...)

#endif

/// Functions are built for each of these widths, and a program takes the widest that its machine has.
/// TESTBED_NARROW leaves out 512 bits, where these take longer.
#if defined(TESTBED_HAS_VECTORS) && defined(__x86_64__)
#define TESTBED_EVERY_WIDTH __attribute__((target_clones("avx512f", "avx2", "default")))
#define TESTBED_NARROW __attribute__((flatten, target_clones("avx2", "default")))
#else
#define TESTBED_EVERY_WIDTH
#define TESTBED_NARROW
#endif
