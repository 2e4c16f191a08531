#include "massspring/springs.h"

#include <algorithm>
#include <cmath>

namespace testbed {
namespace {

/// Adds B to the diagonal blocks of nodes a and b and subtracts it from the blocks between them.
void add_pair(BlockMatrix& K, int a, int b, const Eigen::Matrix3d& B) {
  K.block[K.diagonal[a]] += B;
  K.block[K.diagonal[b]] += B;
  K.block[K.find(a, b)] -= B;
  K.block[K.find(b, a)] -= B;
}

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
// the machine's; nodes are padded to four doubles, so that each is loaded and stored whole. Without
// contraction (CMakeLists.txt) every width gives the same bits.
constexpr int kBatch = 128;
typedef double Padded __attribute__((vector_size(32), aligned(8)));
#define TESTBED_EVERY_WIDTH __attribute__((target_clones("avx512f", "avx2", "default")))

/// @param x, f  4 n doubles
template <class Law>
[[gnu::always_inline]] inline void add_forces_of(const Springs& springs, const double* rest_length,
                                                 const double* x, double* f) {
  const Padded* X = reinterpret_cast<const Padded*>(x);
  Padded* F = reinterpret_cast<Padded*>(f);
  Padded l[kBatch];
  double squared[kBatch], factor[kBatch];
  const int n = static_cast<int>(springs.E.cols());
  for (int first = 0; first < n; first += kBatch) {
    const int m = std::min(kBatch, n - first);
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

TESTBED_EVERY_WIDTH void add_hooke(const Springs& springs, const double* r, const double* x, double* f) {
  add_forces_of<Hooke>(springs, r, x, f);
}
TESTBED_EVERY_WIDTH void add_definite(const Springs& springs, const double* r, const double* x, double* f) {
  add_forces_of<Definite>(springs, r, x, f);
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
  thread_local Eigen::Matrix4Xd padded_x, padded_f;  // kept, so that a step allocates nothing
  padded_x.resize(4, x.cols());
  padded_x.topRows<3>() = x;
  padded_x.row(3).setZero();
  padded_f.setZero(4, x.cols());
  (springs.law == SpringLaw::Hooke ? add_hooke : add_definite)(springs, rest_length.data(), padded_x.data(),
                                                               padded_f.data());
  f += padded_f.topRows<3>();
}

void add_hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                 BlockMatrix& K) {
  for_each_spring(springs, x, [&](auto law, int s, int a, int b, const Eigen::Vector3d& l, double length) {
    const double k = springs.stiffness(s), r = rest_length(s);
    const double across = std::max(0.0, law.tension(k, length, r) / length);
    const double along = (law.slope(k, length, r) - across) / (length * length);
    add_pair(K, a, b, across * Eigen::Matrix3d::Identity() + along * l * l.transpose());
  });
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

void add_damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale, BlockMatrix& K) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    if (const double squared = l.squaredNorm(); squared > 0)
      add_pair(K, a, b, scale * springs.damping / squared * l * l.transpose());
  }
}

}  // namespace testbed
