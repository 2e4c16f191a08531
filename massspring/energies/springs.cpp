#include "massspring/energies/springs.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "massspring/kernels/every_width.h"
#include "massspring/kernels/parts.h"

namespace testbed::massspring {
namespace {

struct Hooke {
  static double energy(double k, double l, double r) { return k / 2 * (l - r) * (l - r); }
  static double tension(double k, double l, double r) { return k * (l - r); }
  static double slope(double k, double, double) { return k; }
};

struct Definite {
  static double energy(double k, double l, double r) {
    const double q = r / l;
    return l < r ? k * r / 4 * (l + r / 3 * q * q * q - 4 * r / 3) : Hooke::energy(k, l, r);
  }
  static double tension(double k, double l, double r) {
    const double q = r / l, compressed = k * r / 4 * (1 - q * q * q * q), stretched = Hooke::tension(k, l, r);
    return l < r ? compressed : stretched;  // both computed: a loop over springs has no branch
  }
  static double slope(double k, double l, double r) {
    const double q = r / l;
    return l < r ? k * q * q * q * q * q : k;
  }
};

/// Calls visit(law, s, a, b, l, |l|) for every spring that has a length.
template <class Visit>
void for_each_spring(const Springs& springs, const Eigen::Matrix3Xd& x, const Visit& visit) {
  const auto loop = [&](auto law) {
    for (int s = 0; s < springs.E.cols(); ++s) {
      const int a = springs.E(0, s), b = springs.E(1, s);
      const Eigen::Vector3d l = x.col(a) - x.col(b);
      if (const double length = l.norm(); length > 0) visit(law, s, a, b, l, length);
    }
  };
  if (springs.law == SpringLaw::Hooke)
    loop(Hooke());
  else
    loop(Definite());
}

// Forces of many springs. Division and root are done for a batch of springs at once, in registers as wide as
// the machine's; nodes are padded to four doubles, so that each is loaded and stored whole.
constexpr int kBatch = 128;
typedef double Padded __attribute__((vector_size(32), aligned(8)));

/// Springs begin to end - 1 of a body of n nodes.
struct Range {
  int begin, end, n_nodes;
};

/// Bodies of more nodes than fit the second-level cache wait for memory unless the nodes of the springs to
/// come are asked for in time, those where a batch of springs ends being the ones that hardware does not
/// foresee.
[[gnu::always_inline]] inline void prefetch_batch_after(int first, const Range& range,
                                                        const Eigen::Matrix2Xi& E, const Padded* in,
                                                        const Padded* out) {
  constexpr int kNodesInCache = 16384;
  if (range.n_nodes <= kNodesInCache) return;
  for (int s = first + kBatch, end = std::min(s + kBatch, range.end); s < end; ++s) {
    __builtin_prefetch(in + E(1, s));
    __builtin_prefetch(out + E(1, s), 1);
  }
}

/// x_a - x_b of m springs E, and their lengths.
[[gnu::always_inline]] inline void measure(const int* E, int m, const Padded* X, Padded* l, double* length) {
  for (int s = 0; s < m; ++s) {
    l[s] = X[E[2 * s]] - X[E[2 * s + 1]];
    const Padded squares = l[s] * l[s];
    length[s] = squares[0] + squares[1] + squares[2];
  }
  for (int s = 0; s < m; ++s) length[s] = std::sqrt(length[s]);
}

/// @param X, F  a column for each node
template <class Law>
[[gnu::always_inline]] inline void add_forces_of(const Springs& springs, const double* rest_length,
                                                 const Range& range, const Padded* X, Padded* F) {
  Padded l[kBatch];
  double length[kBatch], factor[kBatch];
  for (int first = range.begin; first < range.end; first += kBatch) {
    prefetch_batch_after(first, range, springs.E, X, F);
    const int m = std::min(kBatch, range.end - first);
    const int* E = springs.E.data() + 2 * first;
    const double *k = springs.stiffness.data() + first, *r = rest_length + first;
    measure(E, m, X, l, length);
    for (int s = 0; s < m; ++s) {
      const double t = Law::tension(k[s], length[s], r[s]) / length[s];
      factor[s] = length[s] > 0 ? t : 0;
    }
    for (int s = 0; s < m;) {  // springs of one first node follow each other: its sum stays in a register
      const int a = E[2 * s];
      Padded sum{};
      do {
        const Padded force = factor[s] * l[s];
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
[[gnu::always_inline]] inline void hessian_of(const Springs& springs, const double* rest_length, double scale,
                                              double least, const Padded* X, Padded* B) {
  Padded l[kBatch];
  double length[kBatch], along[kBatch], across[kBatch];
  for (int first = 0, n = static_cast<int>(springs.E.cols()); first < n; first += kBatch) {
    const int m = std::min(kBatch, n - first);
    const double *k = springs.stiffness.data() + first, *r = rest_length + first;
    measure(springs.E.data() + 2 * first, m, X, l, length);
    for (int s = 0; s < m; ++s) {
      const double t = std::max(least, Law::tension(k[s], length[s], r[s]) / length[s]);
      const double u = std::sqrt(scale * (Law::slope(k[s], length[s], r[s]) - t)) / length[s];
      along[s] = length[s] > 0 ? u : 0;
      across[s] = length[s] > 0 ? scale * t : 0;
    }
    for (int s = 0; s < m; ++s) {
      Padded block = along[s] * l[s];
      block[3] = across[s];
      B[first + s] = block;
    }
  }
}

TESTBED_EVERY_WIDTH void hooke_hessian(const Springs& springs, const double* r, double scale, double least,
                                       const Padded* x, Padded* B) {
  hessian_of<Hooke>(springs, r, scale, least, x, B);
}
TESTBED_EVERY_WIDTH void definite_hessian(const Springs& springs, const double* r, double scale, double least,
                                          const Padded* x, Padded* B) {
  hessian_of<Definite>(springs, r, scale, least, x, B);
}

/// Lanes xx yy zz and xy yz zx of the blocks' sums at nodes.
TESTBED_EVERY_WIDTH void add_diagonal_of(const Eigen::Matrix2Xi& pairs, const Padded* block, Padded* diagonal,
                                         Padded* off_diagonal) {
  const int* E = pairs.data();
  for (Eigen::Index s = 0; s < pairs.cols(); ++s) {
    const Padded u = block[s], d = u * u + u[3], o = u * __builtin_shufflevector(u, u, 1, 2, 0, 3);
    for (int i : {E[2 * s], E[2 * s + 1]}) {
      diagonal[i] += d;
      off_diagonal[i] += o;
    }
  }
}

/// @param block, P, Y  a column for each spring, node, node
TESTBED_EVERY_WIDTH void add_padded_product(const Eigen::Matrix2Xi& pairs, const Padded* block,
                                            const Range& range, const Padded* P, Padded* Y) {
  const int* E = pairs.data();
  for (int first = range.begin; first < range.end; first += kBatch) {
    prefetch_batch_after(first, range, pairs, P, Y);
    for (int s = first, end = std::min(range.end, first + kBatch); s < end;) {
      const int a = E[2 * s];
      const Padded p_a = P[a];
      Padded sum{};
      do {
        const Padded d = p_a - P[E[2 * s + 1]], u = block[s], products = u * d;
        const Padded q = u * (products[0] + products[1] + products[2]) + d * u[3];
        Y[E[2 * s + 1]] -= q;
        sum += q;
        ++s;
      } while (s < end && E[2 * s] == a);
      Y[a] += sum;
    }
  }
}

TESTBED_EVERY_WIDTH void add_hooke(const Springs& springs, const double* r, const Range& range,
                                   const Padded* x, Padded* f) {
  add_forces_of<Hooke>(springs, r, range, x, f);
}
TESTBED_EVERY_WIDTH void add_definite(const Springs& springs, const double* r, const Range& range,
                                      const Padded* x, Padded* f) {
  add_forces_of<Definite>(springs, r, range, x, f);
}

/// A column for each node of a field, until it is called again.
const Padded* pad(const Eigen::Matrix3Xd& in) {
  thread_local Eigen::Matrix4Xd kept;  // so that a step allocates nothing
  const Eigen::Index n = in.cols();
  kept.resize(4, n);
  Eigen::Map<Eigen::Matrix4Xd> padded(kept.data(), 4, n);
  for_each_chunk(n, [&](Eigen::Index begin, Eigen::Index end) {
    padded.middleCols(begin, end - begin).topRows<3>() = in.middleCols(begin, end - begin);
    padded.middleCols(begin, end - begin).row(3).setZero();
  });
  return reinterpret_cast<const Padded*>(padded.data());
}

/// Calls kernel(range of springs; a column of in for each node; one that it adds to) for all springs, those
/// of different parts at once, and adds the result to out.
template <class Kernel>
void apply_padded(const Springs& springs, const Kernel& kernel, const Eigen::Matrix3Xd& in,
                  Eigen::Matrix3Xd& out) {
  thread_local Eigen::Matrix4Xd kept_out;
  const int n = static_cast<int>(in.cols());
  kept_out.resize(4, n);
  Eigen::Map<Eigen::Matrix4Xd> padded_out(kept_out.data(), 4, n);
  for_each_chunk(
      n, [&](Eigen::Index begin, Eigen::Index end) { padded_out.middleCols(begin, end - begin).setZero(); });
  const Padded* const P = pad(in);
  auto* const Y = reinterpret_cast<Padded*>(padded_out.data());
  const std::vector<int>& first = springs.first;
  if (first.empty())
    kernel(Range{0, static_cast<int>(springs.E.cols()), n}, P, Y);
  else
    for_each_part([&](int part) {
      for (int k : {part, n_parts + part}) kernel(Range{first[k], first[k + 1], n}, P, Y);
    });
  for_each_chunk(n, [&](Eigen::Index begin, Eigen::Index end) {
    out.middleCols(begin, end - begin) += padded_out.middleCols(begin, end - begin).topRows<3>();
  });
}

Eigen::Matrix3d matrix_of(const SpringBlocks& B, int s) {
  return B.col(s).head<3>() * B.col(s).head<3>().transpose() + B(3, s) * Eigen::Matrix3d::Identity();
}

}  // namespace

double energy(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x) {
  double sum = 0;
  for_each_spring(springs, x, [&](auto law, int s, int, int, const Eigen::Vector3d&, double length) {
    sum += law.energy(springs.stiffness(s), length, rest_length(s));
  });
  return sum;
}

void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f) {
  const auto add = springs.law == SpringLaw::Hooke ? add_hooke : add_definite;
  apply_padded(
      springs,
      [&](const Range& range, const Padded* in, Padded* out) {
        add(springs, rest_length.data(), range, in, out);
      },
      x, f);
}

SpringBlocks hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                     double scale, Curvature curvature) {
  const double least = curvature == Curvature::Projected ? 0 : -std::numeric_limits<double>::infinity();
  SpringBlocks B(4, springs.E.cols());
  const auto fill = springs.law == SpringLaw::Hooke ? hooke_hessian : definite_hessian;
  fill(springs, rest_length.data(), scale, least, pad(x), reinterpret_cast<Padded*>(B.data()));
  return B;
}

SpringBlocks damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale) {
  SpringBlocks B = SpringBlocks::Zero(4, springs.E.cols());
  for_each_spring(springs, x, [&](auto, int s, int, int, const Eigen::Vector3d& l, double length) {
    B.col(s).head<3>() = std::sqrt(scale * springs.damping) / length * l;
  });
  return B;
}

void add_blocks(const Springs& springs, const SpringBlocks& B, BlockMatrix& K) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Matrix3d block = matrix_of(B, s);
    K.block[K.diagonal[a]] += block;
    K.block[K.diagonal[b]] += block;
    K.block[K.find(a, b)] -= block;
    K.block[K.find(b, a)] -= block;
  }
}

void add_diagonal(const Springs& springs, const SpringBlocks& B, std::vector<Eigen::Matrix3d>& diagonal) {
  const auto n = static_cast<Eigen::Index>(diagonal.size());
  Eigen::Matrix4Xd D = Eigen::Matrix4Xd::Zero(4, n), O = D;
  add_diagonal_of(springs.E, reinterpret_cast<const Padded*>(B.data()), reinterpret_cast<Padded*>(D.data()),
                  reinterpret_cast<Padded*>(O.data()));
  for (Eigen::Index i = 0; i < n; ++i) {
    Eigen::Matrix3d block;
    block << D(0, i), O(0, i), O(2, i), O(0, i), D(1, i), O(1, i), O(2, i), O(1, i), D(2, i);
    diagonal[i] += block;
  }
}

void add_product(const Springs& springs, const SpringBlocks& B, const Eigen::Matrix3Xd& p,
                 Eigen::Matrix3Xd& y) {
  const auto* blocks = reinterpret_cast<const Padded*>(B.data());
  apply_padded(
      springs,
      [&](const Range& range, const Padded* in, Padded* out) {
        add_padded_product(springs.E, blocks, range, in, out);
      },
      p, y);
}

void add_damping_forces(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                        Eigen::Matrix3Xd& f) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    const double squared = l.squaredNorm();
    if (squared == 0) continue;
    const Eigen::Vector3d force = springs.damping * l.dot(v.col(a) - v.col(b)) / squared * l;
    f.col(a) -= force;
    f.col(b) += force;
  }
}

double damping_power(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v) {
  double sum = 0;
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    const double along = l.dot(v.col(a) - v.col(b)), squared = l.squaredNorm();
    if (squared > 0) sum += springs.damping * along * along / squared;
  }
  return sum;
}

}  // namespace testbed::massspring
