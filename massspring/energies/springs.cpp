// Energies, forces and Hessians of springs, as equations (2) to (6) of massspring/README.md say. The laws (3)
// and (6) are in kernels/spring_laws.h. Below the plain loops stand the same sums for registers and caches.
#include "massspring/energies/springs.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "massspring/kernels/spring_kernels.h"
#include "meshing/algebra/vectors.h"

namespace testbed::massspring {
namespace {

/// Calls use(law), the law of springs.
template <class Use>
auto with_law(const Springs& springs, const Use& use) {
  return springs.law == SpringLaw::Hooke ? use(Hooke()) : use(Definite());
}

/// Calls visit(s, a, b, l, |l|) for every spring s that has a length, l = x_a - x_b.
template <class Visit>
void for_each_spring(const Springs& springs, const Eigen::Matrix3Xd& x, const Visit& visit) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    if (const double length = l.norm(); length > 0) visit(s, a, b, l, length);
  }
}

/// B = u u^T + w I of a spring.
Eigen::Matrix3d matrix_of(const SpringBlocks& B, int s) {
  return B.col(s).head<3>() * B.col(s).head<3>().transpose() + B(3, s) * Eigen::Matrix3d::Identity();
}

/// The least t/l in a Hessian.
double least_across(Curvature curvature) {
  return curvature == Curvature::Projected ? 0 : -std::numeric_limits<double>::infinity();
}

SpringPairs arrays_of(const Springs& springs) {
  return {springs.E, springs.first};
}

}  // namespace

double energy(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x) {
  return with_law(springs, [&](auto law) {
    double sum = 0;
    for_each_spring(springs, x, [&](int s, int, int, const Eigen::Vector3d&, double length) {
      sum += law.energy(springs.stiffness(s), length, rest_length(s));
    });
    return sum;
  });
}

namespace plain {

// This is equation (2) without damping.
void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f) {
  with_law(springs, [&](auto law) {
    for_each_spring(springs, x, [&](int s, int a, int b, const Eigen::Vector3d& l, double length) {
      const double t = law.tension(springs.stiffness(s), length, rest_length(s));
      f.col(a) -= t / length * l;
      f.col(b) += t / length * l;
    });
  });
}

// This is equation (4) with u = sqrt(t' - t/l) n and w = t/l.
SpringBlocks hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                     double scale, Curvature curvature) {
  SpringBlocks B = SpringBlocks::Zero(4, springs.E.cols());
  with_law(springs, [&](auto law) {
    for_each_spring(springs, x, [&](int s, int, int, const Eigen::Vector3d& l, double length) {
      const double k = springs.stiffness(s), r = rest_length(s);
      const double w = std::max(least_across(curvature), law.tension(k, length, r) / length);
      B.col(s) << std::sqrt(scale * (law.slope(k, length, r) - w)) / length * l, scale * w;
    });
  });
  return B;
}

void add_diagonal(const Springs& springs, const SpringBlocks& B, std::vector<Eigen::Matrix3d>& diagonal) {
  for (int s = 0; s < springs.E.cols(); ++s)
    for (int i : springs.E.col(s)) diagonal[i] += matrix_of(B, s);
}

void add_product(const Springs& springs, const SpringBlocks& B, const Eigen::Matrix3Xd& p,
                 Eigen::Matrix3Xd& y) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d q = matrix_of(B, s) * (p.col(a) - p.col(b));
    y.col(a) += q;
    y.col(b) -= q;
  }
}

}  // namespace plain

void add_blocks(const Springs& springs, const SpringBlocks& B, BlockMatrix& K) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Matrix3d block = matrix_of(B, s);
    K.block[K.diagonal[a]] += block;
    K.block[K.diagonal[b]] += block;
    K.block[K.find(std::min(a, b), std::max(a, b))] -= block;
  }
}

SpringBlocks damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale) {
  SpringBlocks B = SpringBlocks::Zero(4, springs.E.cols());
  for_each_spring(springs, x, [&](int s, int, int, const Eigen::Vector3d& l, double length) {
    B.col(s).head<3>() = std::sqrt(scale * springs.damping) / length * l;
  });
  return B;
}

void add_hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                 BlockMatrix& K, Curvature curvature) {
  add_blocks(springs, hessian(springs, rest_length, x, 1, curvature), K);
}

Eigen::Matrix2Xi pairs_of(const Springs& springs) {
  return springs.E;
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

// What runs: the kernels, or without vectors the loops above.

void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f) {
  if (!kHasVectors) return plain::add_forces(springs, rest_length, x, f);
  with_law(springs, [&](auto law) {
    add_spring_forces<decltype(law)>(arrays_of(springs), springs.stiffness.data(), rest_length.data(), x, f);
  });
}

SpringBlocks hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                     double scale, Curvature curvature) {
  if (!kHasVectors) return plain::hessian(springs, rest_length, x, scale, curvature);
  return with_law(springs, [&](auto law) {
    return spring_blocks<decltype(law)>(arrays_of(springs), springs.stiffness.data(), rest_length.data(),
                                        scale, least_across(curvature), x);
  });
}

void add_diagonal(const Springs& springs, const SpringBlocks& B, std::vector<Eigen::Matrix3d>& diagonal) {
  if (!kHasVectors) return plain::add_diagonal(springs, B, diagonal);
  add_spring_diagonal(arrays_of(springs), B, diagonal);
}

void add_product(const Springs& springs, const SpringBlocks& B, const Eigen::Matrix3Xd& p,
                 Eigen::Matrix3Xd& y) {
  if (!kHasVectors) return plain::add_product(springs, B, p, y);
  add_spring_product(arrays_of(springs), B, p, y);
}

}  // namespace testbed::massspring
