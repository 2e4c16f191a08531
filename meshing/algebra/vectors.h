// Vectors of numbers that fill a register, and functions built for several register widths. This is all that
// depends on the compiler and the machine. Without contraction (CMakeLists.txt) every width gives the same
// bits.
#pragma once

#include <type_traits>

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

/// A namespace for what is built for vectors, so that a test may hold it against what is built without.
#define TESTBED_KIND with_vectors

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

#define TESTBED_KIND without_vectors
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

namespace testbed::meshing {

/// A number of each of W things, side by side.
template <int W>
struct Lanes;
template <>
struct Lanes<1> {
  using Vector = double;
};
#ifdef TESTBED_HAS_VECTORS
template <>
struct Lanes<4> {
  using Vector = Double4;
};
template <>
struct Lanes<8> {
  using Vector = Double8;
};
#endif

#if defined(TESTBED_HAS_VECTORS) && defined(__x86_64__)
template <class Work>
__attribute__((target("avx512f,avx512vl,avx512dq"))) void by_512_bits(const Work& work) {
  work(std::integral_constant<int, 8>());
}
template <class Work>
__attribute__((target("avx2"))) void by_256_bits(const Work& work) {
  work(std::integral_constant<int, 4>());
}
#endif

/// Calls work(W), always inlined, for as many doubles W as the machine's registers hold, 1 without vectors.
template <class Work>
void by_width(const Work& work) {
#ifdef TESTBED_HAS_VECTORS
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512dq"))
    return by_512_bits(work);
  if (__builtin_cpu_supports("avx2")) return by_256_bits(work);
#endif
  work(std::integral_constant<int, 4>());
#else
  work(std::integral_constant<int, 1>());
#endif
}

}  // namespace testbed::meshing
