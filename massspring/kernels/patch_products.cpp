#include "massspring/kernels/patch_kernels.h"
#include "massspring/kernels/patch_lanes.h"

namespace testbed::massspring {
namespace {

/// Components of the vectors of eight nodes side by side, and back.
[[gnu::always_inline]] inline void split(const Float4* v, Float8* components) {
  Float8 pairs[4];  // each of node i and node i + 4
  for (int i = 0; i < 4; ++i) pairs[i] = TESTBED_SHUFFLED(v[i], v[i + 4], 0, 1, 2, 3, 4, 5, 6, 7);
  const Float8 xy = TESTBED_SHUFFLED(pairs[0], pairs[1], 0, 8, 1, 9, 4, 12, 5, 13),
               xy_2 = TESTBED_SHUFFLED(pairs[2], pairs[3], 0, 8, 1, 9, 4, 12, 5, 13),
               z = TESTBED_SHUFFLED(pairs[0], pairs[1], 2, 10, 3, 11, 6, 14, 7, 15),
               z_2 = TESTBED_SHUFFLED(pairs[2], pairs[3], 2, 10, 3, 11, 6, 14, 7, 15);
  components[0] = TESTBED_SHUFFLED(xy, xy_2, 0, 1, 8, 9, 4, 5, 12, 13);
  components[1] = TESTBED_SHUFFLED(xy, xy_2, 2, 3, 10, 11, 6, 7, 14, 15);
  components[2] = TESTBED_SHUFFLED(z, z_2, 0, 1, 8, 9, 4, 5, 12, 13);
}
[[gnu::always_inline]] inline void join(const Float8* components, Float4* v) {
  const Float8 x = components[0], y = components[1], z = components[2], none{};
  const Float8 xy = TESTBED_SHUFFLED(x, y, 0, 8, 1, 9, 4, 12, 5, 13),
               z_0 = TESTBED_SHUFFLED(z, none, 0, 8, 1, 9, 4, 12, 5, 13),
               xy_2 = TESTBED_SHUFFLED(x, y, 2, 10, 3, 11, 6, 14, 7, 15),
               z_2 = TESTBED_SHUFFLED(z, none, 2, 10, 3, 11, 6, 14, 7, 15);
  const Float8 pairs[4] = {TESTBED_SHUFFLED(xy, z_0, 0, 1, 8, 9, 4, 5, 12, 13),
                           TESTBED_SHUFFLED(xy, z_0, 2, 3, 10, 11, 6, 7, 14, 15),
                           TESTBED_SHUFFLED(xy_2, z_2, 0, 1, 8, 9, 4, 5, 12, 13),
                           TESTBED_SHUFFLED(xy_2, z_2, 2, 3, 10, 11, 6, 7, 14, 15)};
  for (int i = 0; i < 4; ++i) {
    v[i] = TESTBED_SHUFFLED(pairs[i], pairs[i], 0, 1, 2, 3);
    v[i + 4] = TESTBED_SHUFFLED(pairs[i], pairs[i], 4, 5, 6, 7);
  }
}

/// Nodes and vectors from those of the first of n entries on.
[[gnu::always_inline]] inline void add_product_of_batch(int n, const int* node, const Float8* b,
                                                        const Float8& lambda, const Float8& mu,
                                                        const Float4* p, Float4* y) {
  Float8 H[3][3] = {};  // its columns
  Float4 at[kBatchSize];
  for (int e = 0; e < n; ++e) {
    for (int i = 0; i < kBatchSize; ++i) at[i] = p[node[kBatchSize * e + i]];
    Float8 p_e[3];
    split(at, p_e);
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) H[j][i] += p_e[i] * b[3 * e + j];
  }
  const Float8 pressure = lambda * (H[0][0] + H[1][1] + H[2][2]);
  Float8 P[3][3];
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) {
      P[j][i] = mu * (H[j][i] + H[i][j]);
      if (i == j) P[j][i] += pressure;
    }
  for (int e = 0; e < n; ++e) {
    Float8 P_b[3];
    for (int i = 0; i < 3; ++i) P_b[i] = P[0][i] * b[3 * e] + P[1][i] * b[3 * e + 1] + P[2][i] * b[3 * e + 2];
    join(P_b, at);
    for (int i = 0; i < kBatchSize; ++i) y[node[kBatchSize * e + i]] += at[i];
  }
}

TESTBED_NARROW void add_products(int begin, int end, const int* start, const int* node, const float* b,
                                 const float* lambda, const float* mu, const float* p, float* y) {
  const Float8* B = reinterpret_cast<const Float8*>(b);  // NOLINT(modernize-use-auto): it forgets alignment
  const Float8* L = reinterpret_cast<const Float8*>(lambda);  // NOLINT(modernize-use-auto)
  const Float8* M = reinterpret_cast<const Float8*>(mu);      // NOLINT(modernize-use-auto)
  for (int batch = begin; batch < end; ++batch) {
    const std::ptrdiff_t first = start[batch];
    add_product_of_batch(start[batch + 1] - start[batch], node + kBatchSize * first, B + 3 * first, L[batch],
                         M[batch], reinterpret_cast<const Float4*>(p), reinterpret_cast<Float4*>(y));
  }
}

}  // namespace

SinglePatches single_precision(const PatchBatches& batches, const PatchArrays& of) {
  const std::size_t n = kBatchSize * static_cast<std::size_t>(batches.n_batches());
  SinglePatches single{{batches.b.begin(), batches.b.end()}, std::vector<float>(n), std::vector<float>(n)};
  for (int batch = 0; batch < batches.n_batches(); ++batch)
    for (int p = batches.first[batch], at = kBatchSize * batch; p < batches.first[batch + 1]; ++p, ++at) {
      single.lambda[at] = static_cast<float>(of.volume[p] * of.lambda[p]);
      single.mu[at] = static_cast<float>(of.volume[p] * of.mu);
    }
  return single;
}

void add_patch_products(int begin, int end, const PatchBatches& batches, const SinglePatches& of,
                        const float* p, float* y) {
  add_products(begin, end, batches.start.data(), batches.node.data(), of.b.data(), of.lambda.data(),
               of.mu.data(), p, y);
}

}  // namespace testbed::massspring
