// Parts that the kernels of coupled springs share. Every function is inlined into those that are built for a
// width of registers.
#pragma once

#include <algorithm>

#include "massspring/kernels/patch_kernels.h"

namespace testbed::massspring {
inline namespace TESTBED_KIND {

template <int W>
using Vector = typename Lanes<W>::Vector;

#ifdef TESTBED_HAS_VECTORS
[[gnu::always_inline]] inline double number(const Double4& x, int i) {
  return x[i];
}
[[gnu::always_inline]] inline double number(const Double8& x, int i) {
  return x[i];
}

/// Components of four vectors, each component side by side.
[[gnu::always_inline]] inline void split(const Double4* v, Double4& x, Double4& y, Double4& z) {
  const Double4 even = TESTBED_SHUFFLED(v[0], v[1], 0, 4, 2, 6),
                odd = TESTBED_SHUFFLED(v[0], v[1], 1, 5, 3, 7),
                even_2 = TESTBED_SHUFFLED(v[2], v[3], 0, 4, 2, 6),
                odd_2 = TESTBED_SHUFFLED(v[2], v[3], 1, 5, 3, 7);
  x = TESTBED_SHUFFLED(even, even_2, 0, 1, 4, 5);
  y = TESTBED_SHUFFLED(odd, odd_2, 0, 1, 4, 5);
  z = TESTBED_SHUFFLED(even, even_2, 2, 3, 6, 7);
}
[[gnu::always_inline]] inline void join(const Double4& x, const Double4& y, const Double4& z, Double4* v) {
  const Double4 even = TESTBED_SHUFFLED(x, y, 0, 4, 2, 6), odd = TESTBED_SHUFFLED(x, y, 1, 5, 3, 7),
                even_z = TESTBED_SHUFFLED(z, z, 0, 0, 2, 2), odd_z = TESTBED_SHUFFLED(z, z, 1, 1, 3, 3);
  v[0] = TESTBED_SHUFFLED(even, even_z, 0, 1, 4, 5);
  v[1] = TESTBED_SHUFFLED(odd, odd_z, 0, 1, 4, 5);
  v[2] = TESTBED_SHUFFLED(even, even_z, 2, 3, 6, 7);
  v[3] = TESTBED_SHUFFLED(odd, odd_z, 2, 3, 6, 7);
}

/// The same of eight.
[[gnu::always_inline]] inline void split(const Double4* v, Double8& x, Double8& y, Double8& z) {
  const Double8 a = TESTBED_SHUFFLED(v[0], v[1], 0, 1, 2, 3, 4, 5, 6, 7),
                b = TESTBED_SHUFFLED(v[2], v[3], 0, 1, 2, 3, 4, 5, 6, 7),
                c = TESTBED_SHUFFLED(v[4], v[5], 0, 1, 2, 3, 4, 5, 6, 7),
                d = TESTBED_SHUFFLED(v[6], v[7], 0, 1, 2, 3, 4, 5, 6, 7);
  const Double8 xy = TESTBED_SHUFFLED(a, b, 0, 4, 8, 12, 1, 5, 9, 13),
                xy_2 = TESTBED_SHUFFLED(c, d, 0, 4, 8, 12, 1, 5, 9, 13),
                zz = TESTBED_SHUFFLED(a, b, 2, 6, 10, 14, 2, 6, 10, 14),
                zz_2 = TESTBED_SHUFFLED(c, d, 2, 6, 10, 14, 2, 6, 10, 14);
  x = TESTBED_SHUFFLED(xy, xy_2, 0, 1, 2, 3, 8, 9, 10, 11);
  y = TESTBED_SHUFFLED(xy, xy_2, 4, 5, 6, 7, 12, 13, 14, 15);
  z = TESTBED_SHUFFLED(zz, zz_2, 0, 1, 2, 3, 8, 9, 10, 11);
}
[[gnu::always_inline]] inline void join(const Double8& x, const Double8& y, const Double8& z, Double4* v) {
  const Double8 low = TESTBED_SHUFFLED(x, y, 0, 8, 1, 9, 2, 10, 3, 11),
                high = TESTBED_SHUFFLED(x, y, 4, 12, 5, 13, 6, 14, 7, 15);
  Double8* const pair = reinterpret_cast<Double8*>(v);  // NOLINT(modernize-use-auto): it forgets alignment
  pair[0] = TESTBED_SHUFFLED(low, z, 0, 1, 8, 8, 2, 3, 9, 9);
  pair[1] = TESTBED_SHUFFLED(low, z, 4, 5, 10, 10, 6, 7, 11, 11);
  pair[2] = TESTBED_SHUFFLED(high, z, 0, 1, 12, 12, 2, 3, 13, 13);
  pair[3] = TESTBED_SHUFFLED(high, z, 4, 5, 14, 14, 6, 7, 15, 15);
}
#else
[[gnu::always_inline]] inline void split(const Double4* v, double& x, double& y, double& z) {
  x = v[0][0];
  y = v[0][1];
  z = v[0][2];
}
[[gnu::always_inline]] inline void join(double x, double y, double z, Double4* v) {
  v[0] = Double4{x, y, z, 0};
}

[[gnu::always_inline]] inline double number(double x, int) {
  return x;
}
#endif

template <int W>
[[gnu::always_inline]] inline Vector<W> load(const double* numbers) {
  return *reinterpret_cast<const Vector<W>*>(numbers);
}

/// Of the first n patches of a batch; the list may end there.
template <int W>
[[gnu::always_inline]] inline Vector<W> load(const double* list, int n) {
  if (n >= W) return load<W>(list);
  double numbers[W];
  std::fill(std::copy_n(list, n, numbers), numbers + W, 1.);
  return load<W>(numbers);
}

/// 3 x 3 matrices of a batch by columns.
template <int W>
struct Batch {
  Vector<W> column[3][3];
};

/// A part of W patches of a batch, of which those that exist are n from the first on.
template <int W>
struct Part {
  int lane, first, n;
};

/// H = F - I, F = (I + sum_e u_e b_e^T) over the scale of the rest shape.
template <int W>
[[gnu::always_inline]] inline Batch<W> measure(const PatchBatches& batches, int batch, const Part<W>& part,
                                               const PatchArrays& of, const Double4* u) {
  Batch<W> H;
  for (int j = 0; j < 3; ++j)  // as H{} it would be filled in memory, and references forget alignment
    for (int i = 0; i < 3; ++i) H.column[j][i] = Vector<W>{};
  for (int e = batches.start[batch]; e < batches.start[batch + 1]; ++e) {
    const int* const node = batches.node.data() + kBatchSize * e + part.lane;
    const double* const b = batches.b.data() + 3 * kBatchSize * e + part.lane;
    Double4 at[W];
    for (int i = 0; i < W; ++i) at[i] = u[node[i]];
    Vector<W> u_e[3];
    split(at, u_e[0], u_e[1], u_e[2]);
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) H.column[j][i] += u_e[i] * load<W>(b + j * kBatchSize);
  }
  if (of.scale) {
    const Vector<W> scale = load<W>(of.scale + part.first, part.n);
    for (int j = 0; j < 3; ++j) {
      H.column[j][j] = H.column[j][j] + (1. - scale);
      for (int i = 0; i < 3; ++i) H.column[j][i] = H.column[j][i] / scale;
    }
  }
  return H;
}

template <int W>
[[gnu::always_inline]] inline void cross(const Vector<W>* a, const Vector<W>* b, Vector<W>* c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

template <int W>
[[gnu::always_inline]] inline Vector<W> dot(const Vector<W>* a, const Vector<W>* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// What the law takes of H, without the rounding of ones beside it.
template <int W>
struct Strain {
  Batch<W> F, C;          ///< C = cof F
  Vector<W> C_1[3], J_1;  ///< the diagonal of C - I, and det F - 1
};
template <int W>
[[gnu::always_inline]] inline Strain<W> strain_of(const Batch<W>& H) {
  Strain<W> of;
  of.F = H;
  for (int k = 0; k < 3; ++k) of.F.column[k][k] = of.F.column[k][k] + 1.;
  for (int k = 0; k < 3; ++k) cross<W>(of.F.column[(k + 1) % 3], of.F.column[(k + 2) % 3], of.C.column[k]);
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    of.C_1[k] =
        H.column[i][i] + H.column[j][j] + (H.column[i][i] * H.column[j][j] - H.column[j][i] * H.column[i][j]);
  }
  const Vector<W>* const h = H.column[0];
  of.J_1 = h[0] + of.C_1[0] + h[0] * of.C_1[0] + h[1] * of.C.column[0][1] + h[2] * of.C.column[0][2];
  return of;
}

/// The part of a batch from a lane on.
template <int W>
[[gnu::always_inline]] inline Part<W> part_of(const PatchBatches& batches, int batch, int lane) {
  const int first = batches.first[batch] + lane;
  return {lane, first, std::clamp(batches.first[batch + 1] - first, 0, W)};
}

}  // namespace TESTBED_KIND
}  // namespace testbed::massspring
