#include "massspring/kernels/spring_kernels.h"

#include <algorithm>
#include <cmath>

#include "massspring/kernels/padded_nodes.h"

namespace testbed::massspring {
namespace {

// Division and root are done for a batch of springs at once, in registers as wide as the machine's; nodes are
// padded to four doubles, so that each is loaded and stored whole.
constexpr int kBatch = 128;

/// Springs begin to end - 1 of a body of n nodes.
struct Range {
  int begin, end, n_nodes;
};

/// Bodies of more nodes than fit the second-level cache wait for memory unless the nodes of the springs to
/// come are asked for in time, those where a batch of springs ends being the ones that hardware does not
/// foresee.
[[gnu::always_inline]] inline void prefetch_batch_after(int first, const Range& range, const int* E,
                                                        [[maybe_unused]] const Double4* in,
                                                        [[maybe_unused]] const Double4* out) {
  constexpr int kNodesInCache = 16384;
  if (range.n_nodes <= kNodesInCache) return;
  for (int s = first + kBatch, end = std::min(s + kBatch, range.end); s < end; ++s) {
    TESTBED_PREFETCH(in + E[2 * s + 1]);
    TESTBED_PREFETCH(out + E[2 * s + 1], 1);
  }
}

/// x_a - x_b of m springs E, and their lengths.
[[gnu::always_inline]] inline void measure(const int* E, int m, const Double4* X, Double4* l,
                                           double* length) {
  for (int s = 0; s < m; ++s) {
    l[s] = X[E[2 * s]] - X[E[2 * s + 1]];
    const Double4 squares = l[s] * l[s];
    length[s] = squares[0] + squares[1] + squares[2];
  }
  for (int s = 0; s < m; ++s) length[s] = std::sqrt(length[s]);
}

/// @param X, F  a column for each node
template <class Law>
[[gnu::always_inline]] inline void add_forces_of(const int* pairs, const double* stiffness,
                                                 const double* rest_length, const Range& range,
                                                 const Double4* X, Double4* F) {
  Double4 l[kBatch];
  double length[kBatch], factor[kBatch];
  for (int first = range.begin; first < range.end; first += kBatch) {
    prefetch_batch_after(first, range, pairs, X, F);
    const int m = std::min(kBatch, range.end - first);
    const int* E = pairs + 2 * first;
    const double *k = stiffness + first, *r = rest_length + first;
    measure(E, m, X, l, length);
    for (int s = 0; s < m; ++s) {
      const double t = Law::tension(k[s], length[s], r[s]) / length[s];
      factor[s] = length[s] > 0 ? t : 0;
    }
    for (int s = 0; s < m;) {  // springs of one first node follow each other: its sum stays in a register
      const int a = E[2 * s];
      Double4 sum{};
      do {
        const Double4 force = factor[s] * l[s];
        F[E[2 * s + 1]] += force;
        sum += force;
        ++s;
      } while (s < m && E[2 * s] == a);
      F[a] -= sum;
    }
  }
}

/// @param X, B  a column for each node, spring
template <class Law>
[[gnu::always_inline]] inline void fill_blocks(const int* pairs, int n, const double* stiffness,
                                               const double* rest_length, double scale, double least,
                                               const Double4* X, Double4* B) {
  Double4 l[kBatch];
  double length[kBatch], along[kBatch], across[kBatch];
  for (int first = 0; first < n; first += kBatch) {
    const int m = std::min(kBatch, n - first);
    const double *k = stiffness + first, *r = rest_length + first;
    measure(pairs + 2 * first, m, X, l, length);
    for (int s = 0; s < m; ++s) {
      const double t = std::max(least, Law::tension(k[s], length[s], r[s]) / length[s]);
      const double u = std::sqrt(scale * (Law::slope(k[s], length[s], r[s]) - t)) / length[s];
      along[s] = length[s] > 0 ? u : 0;
      across[s] = length[s] > 0 ? scale * t : 0;
    }
    for (int s = 0; s < m; ++s) {
      Double4 block = along[s] * l[s];
      block[3] = across[s];
      B[first + s] = block;
    }
  }
}

// Templates are not built for several widths.
TESTBED_EVERY_WIDTH void add_forces_by(Hooke, const int* E, const double* k, const double* r,
                                       const Range& range, const Double4* x, Double4* f) {
  add_forces_of<Hooke>(E, k, r, range, x, f);
}
TESTBED_EVERY_WIDTH void add_forces_by(Definite, const int* E, const double* k, const double* r,
                                       const Range& range, const Double4* x, Double4* f) {
  add_forces_of<Definite>(E, k, r, range, x, f);
}
TESTBED_EVERY_WIDTH void fill_blocks_by(Hooke, const int* E, int n, const double* k, const double* r,
                                        double scale, double least, const Double4* x, Double4* B) {
  fill_blocks<Hooke>(E, n, k, r, scale, least, x, B);
}
TESTBED_EVERY_WIDTH void fill_blocks_by(Definite, const int* E, int n, const double* k, const double* r,
                                        double scale, double least, const Double4* x, Double4* B) {
  fill_blocks<Definite>(E, n, k, r, scale, least, x, B);
}

/// Lanes xx yy zz and xy yz zx of the blocks' sums at nodes.
TESTBED_EVERY_WIDTH void add_diagonal_by(const int* E, Eigen::Index n, const Double4* block,
                                         Double4* diagonal, Double4* off_diagonal) {
  for (Eigen::Index s = 0; s < n; ++s) {
    const Double4 u = block[s], d = u * u + u[3], o = u * TESTBED_SHUFFLED(u, u, 1, 2, 0, 3);
    for (int i : {E[2 * s], E[2 * s + 1]}) {
      diagonal[i] += d;
      off_diagonal[i] += o;
    }
  }
}

/// @param block, P, Y  a column for each spring, node, node
TESTBED_EVERY_WIDTH void add_product_by(const int* E, const Double4* block, const Range& range,
                                        const Double4* P, Double4* Y) {
  for (int first = range.begin; first < range.end; first += kBatch) {
    prefetch_batch_after(first, range, E, P, Y);
    for (int s = first, end = std::min(range.end, first + kBatch); s < end;) {
      const int a = E[2 * s];
      const Double4 p_a = P[a];
      Double4 sum{};
      do {
        const Double4 d = p_a - P[E[2 * s + 1]], u = block[s], products = u * d;
        const Double4 q = u * (products[0] + products[1] + products[2]) + d * u[3];
        Y[E[2 * s + 1]] -= q;
        sum += q;
        ++s;
      } while (s < end && E[2 * s] == a);
      Y[a] += sum;
    }
  }
}

/// Calls kernel(range of springs; a column of in for each node; one that it adds to) for all springs, those
/// of different subdomains at once, and adds the result to out.
template <class Kernel>
void apply_padded(const SpringPairs& springs, const Kernel& kernel, const Eigen::Matrix3Xd& in,
                  Eigen::Matrix3Xd& out) {
  const int n = static_cast<int>(in.cols());
  const std::vector<int>& first = springs.first;
  add_padded(
      [&](const Double4* P, Double4* Y) {
        if (first.empty()) return kernel(Range{0, static_cast<int>(springs.E.cols()), n}, P, Y);
        for_each_subdomain([&](int subdomain) {
          for (int k : {subdomain, kSubdomains + subdomain}) kernel(Range{first[k], first[k + 1], n}, P, Y);
        });
      },
      in, out);
}

}  // namespace

template <class Law>
void add_spring_forces(const SpringPairs& springs, const double* k, const double* r,
                       const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) {
  apply_padded(
      springs,
      [&](const Range& range, const Double4* in, Double4* out) {
        add_forces_by(Law(), springs.E.data(), k, r, range, in, out);
      },
      x, f);
}
template void add_spring_forces<Hooke>(const SpringPairs&, const double*, const double*,
                                       const Eigen::Matrix3Xd&, Eigen::Matrix3Xd&);
template void add_spring_forces<Definite>(const SpringPairs&, const double*, const double*,
                                          const Eigen::Matrix3Xd&, Eigen::Matrix3Xd&);

template <class Law>
Eigen::Matrix4Xd spring_blocks(const SpringPairs& springs, const double* k, const double* r, double scale,
                               double least, const Eigen::Matrix3Xd& x) {
  Eigen::Matrix4Xd B(4, springs.E.cols());
  fill_blocks_by(Law(), springs.E.data(), static_cast<int>(B.cols()), k, r, scale, least, pad(x),
                 reinterpret_cast<Double4*>(B.data()));
  return B;
}
template Eigen::Matrix4Xd spring_blocks<Hooke>(const SpringPairs&, const double*, const double*, double,
                                               double, const Eigen::Matrix3Xd&);
template Eigen::Matrix4Xd spring_blocks<Definite>(const SpringPairs&, const double*, const double*, double,
                                                  double, const Eigen::Matrix3Xd&);

void add_spring_diagonal(const SpringPairs& springs, const Eigen::Matrix4Xd& B,
                         std::vector<Eigen::Matrix3d>& diagonal) {
  const auto n = static_cast<Eigen::Index>(diagonal.size());
  Eigen::Matrix4Xd D = Eigen::Matrix4Xd::Zero(4, n), O = D;
  add_diagonal_by(springs.E.data(), springs.E.cols(), reinterpret_cast<const Double4*>(B.data()),
                  reinterpret_cast<Double4*>(D.data()), reinterpret_cast<Double4*>(O.data()));
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::Matrix3d block;
    block << D(0, i), O(0, i), O(2, i), O(0, i), D(1, i), O(1, i), O(2, i), O(1, i), D(2, i);
    diagonal[i] += block;
  }
}

void add_spring_product(const SpringPairs& springs, const Eigen::Matrix4Xd& B, const Eigen::Matrix3Xd& p,
                        Eigen::Matrix3Xd& y) {
  const auto* blocks = reinterpret_cast<const Double4*>(B.data());
  apply_padded(
      springs,
      [&](const Range& range, const Double4* in, Double4* out) {
        add_product_by(springs.E.data(), blocks, range, in, out);
      },
      p, y);
}

}  // namespace testbed::massspring
