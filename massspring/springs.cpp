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
    const double q = r / l;
    return l < r ? k * r / 4 * (1 - q * q * q * q) : Hooke::tension(k, l, r);
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
  for_each_spring(springs, x, [&](auto law, int s, int a, int b, const Eigen::Vector3d& l, double length) {
    const Eigen::Vector3d force = law.tension(springs.stiffness(s), length, rest_length(s)) / length * l;
    f.col(a) -= force;
    f.col(b) += force;
  });
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
