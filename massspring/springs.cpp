#include "massspring/springs.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "massspring/every_width.h"
#include "massspring/parts.h"

namespace testbed {
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

/// @param X, F  a column for each node
template <class Law>
[[gnu::always_inline]] inline void add_forces_of(const Springs& springs, const double* rest_length,
                                                 const Range& range, const Padded* X, Padded* F) {
  Padded l[kBatch];
  double squared[kBatch], factor[kBatch];
  for (int first = range.begin; first < range.end; first += kBatch) {
    prefetch_batch_after(first, range, springs.E, X, F);
    const int m = std::min(kBatch, range.end - first);
    const int* E = springs.E.data() + 2 * first;
    const double *k = springs.stiffness.data() + first, *r = rest_length + first;
    for (int s = 0; s < m; ++s) {
      l[s] = X[E[2 * s]] - X[E[2 * s + 1]];
      const Padded squares = l[s] * l[s];
      squared[s] = squares[0] + squares[1] + squares[2];
    }
    for (int s = 0; s < m; ++s) {
      const double length = std::sqrt(squared[s]), t = Law::tension(k[s], length, r[s]) / length;
      factor[s] = length > 0 ? t : 0;
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

/// Calls kernel(range of springs; a column of in for each node; one that it adds to) for all springs, those
/// of different parts at once, and adds the result to out.
template <class Kernel>
void apply_padded(const Springs& springs, const Kernel& kernel, const Eigen::Matrix3Xd& in,
                  Eigen::Matrix3Xd& out) {
  thread_local Eigen::Matrix4Xd kept_in, kept_out;  // so that a step allocates nothing
  const int n = static_cast<int>(in.cols());
  kept_in.resize(4, n);
  kept_out.resize(4, n);
  Eigen::Map<Eigen::Matrix4Xd> padded_in(kept_in.data(), 4, n), padded_out(kept_out.data(), 4, n);
  for_each_chunk(n, [&](Eigen::Index begin, Eigen::Index end) {
    const Eigen::Index m = end - begin;
    padded_in.middleCols(begin, m).topRows<3>() = in.middleCols(begin, m);
    padded_in.middleCols(begin, m).row(3).setZero();
    padded_out.middleCols(begin, m).setZero();
  });
  const auto* const P = reinterpret_cast<const Padded*>(padded_in.data());
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
  SpringBlocks B = SpringBlocks::Zero(4, springs.E.cols());
  for_each_spring(springs, x, [&](auto law, int s, int, int, const Eigen::Vector3d& l, double length) {
    const double k = springs.stiffness(s), r = rest_length(s);
    const double across = std::max(least, law.tension(k, length, r) / length);
    B.col(s) << std::sqrt(scale * (law.slope(k, length, r) - across)) / length * l, scale * across;
  });
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
  for (int s = 0; s < springs.E.cols(); ++s) {
    const Eigen::Matrix3d block = matrix_of(B, s);
    for (int i : springs.E.col(s)) diagonal[i] += block;
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

}  // namespace testbed
