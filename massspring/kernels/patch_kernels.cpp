#include "massspring/kernels/patch_kernels.h"

#include "massspring/kernels/patch_lanes.h"
#include "massspring/kernels/patch_law.h"

namespace testbed::massspring {
namespace {

/// dW/dF = s^2 V (mu (F - cof F) + (mu + g') cof F).
template <int W>
[[gnu::always_inline]] inline Batch<W> stress(const PatchArrays& of, const Part<W>& part, const Batch<W>& H) {
  const Strain<W> strain = strain_of<W>(H);
  Vector<W> factor = load<W>(of.volume + part.first, part.n);
  if (of.scale) {
    const Vector<W> s = load<W>(of.scale + part.first, part.n);
    factor = factor * (s * s);
  }
  const Vector<W> of_F = factor * of.mu,
                  of_C = factor * volume_slope(strain.J_1, load<W>(of.lambda + part.first, part.n), of.mu);
  Batch<W> P;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) {
      const Vector<W> C = strain.C.column[j][i];
      P.column[j][i] = of_F * (H.column[j][i] - (i == j ? strain.C_1[j] : C)) + of_C * C;
    }
  return P;
}

/// V (lambda tr H + mu (H + H^T)).
template <int W>
[[gnu::always_inline]] inline Batch<W> linear_stress(const PatchArrays& of, const Part<W>& part,
                                                     const Batch<W>& H) {
  const Vector<W> volume = load<W>(of.volume + part.first, part.n), of_H = volume * of.mu,
                  pressure = volume * load<W>(of.lambda + part.first, part.n) *
                             (H.column[0][0] + H.column[1][1] + H.column[2][2]);
  Batch<W> P;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) {
      P.column[j][i] = of_H * (H.column[j][i] + H.column[i][j]);
      if (i == j) P.column[j][i] += pressure;
    }
  return P;
}

template <int W>
[[gnu::always_inline]] inline void measure_by(int begin, int end, const PatchBatches& batches,
                                              const PatchArrays& of, const Double4* u, double* det_1,
                                              double* squares_3) {
  for (int batch = begin; batch < end; ++batch)
    for (int lane = 0; lane < kBatchSize; lane += W) {
      const Part<W> part = part_of<W>(batches, batch, lane);
      const Batch<W> H = measure<W>(batches, batch, part, of, u);
      const Vector<W> J_1 = strain_of<W>(H).J_1, trace = H.column[0][0] + H.column[1][1] + H.column[2][2],
                      squares =
                          2. * trace + (dot<W>(H.column[0], H.column[0]) + dot<W>(H.column[1], H.column[1]) +
                                        dot<W>(H.column[2], H.column[2]));
      for (int i = 0; i < part.n; ++i) {
        *det_1++ = number(J_1, i);
        *squares_3++ = number(squares, i);
      }
    }
}

template <int W, bool is_linear>
[[gnu::always_inline]] inline void add_forces_by(int begin, int end, const PatchBatches& batches,
                                                 const PatchArrays& of, const Double4* u, Double4* f) {
  constexpr int kParts = kBatchSize / W;
  for (int batch = begin; batch < end; ++batch) {
    Batch<W> P[kParts];
    for (int k = 0; k < kParts; ++k) {
      const Part<W> part = part_of<W>(batches, batch, k * W);
      const Batch<W> H = measure<W>(batches, batch, part, of, u);
      P[k] = is_linear ? linear_stress<W>(of, part, H) : stress<W>(of, part, H);
    }
    for (int e = batches.start[batch]; e < batches.start[batch + 1]; ++e) {
      const int* const node = batches.node.data() + kBatchSize * e;
      const double* const b = batches.b.data() + 3 * kBatchSize * e;
      Double4 force[kBatchSize];
      for (int k = 0; k < kParts; ++k) {
        Vector<W> P_b[3];
        for (int i = 0; i < 3; ++i)
          P_b[i] = P[k].column[0][i] * load<W>(b + k * W) +
                   P[k].column[1][i] * load<W>(b + kBatchSize + k * W) +
                   P[k].column[2][i] * load<W>(b + 2 * kBatchSize + k * W);
        join(P_b[0], P_b[1], P_b[2], force + k * W);
      }
      for (int i = 0; i < kBatchSize; ++i) f[node[i]] -= force[i];
    }
  }
}

}  // namespace

void measure_patches(int begin, int end, const PatchBatches& batches, const PatchArrays& of, const Double4* u,
                     double* det_1, double* squares_3) {
  by_width([&](auto width)
               TESTBED_INLINE { measure_by<width>(begin, end, batches, of, u, det_1, squares_3); });
}

void add_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                      const Double4* u, Double4* f) {
  by_width([&](auto width) TESTBED_INLINE { add_forces_by<width, false>(begin, end, batches, of, u, f); });
}

void add_linear_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                             const Double4* u, Double4* f) {
  by_width([&](auto width) TESTBED_INLINE { add_forces_by<width, true>(begin, end, batches, of, u, f); });
}

}  // namespace testbed::massspring
