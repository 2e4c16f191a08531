#include "massspring/springs.h"

#include <algorithm>
#include <cmath>

namespace testbed {
namespace {

/// Adds B to the diagonal blocks of nodes a and b and subtracts it from the blocks between them.
void add_pair(BlockMatrix& K, int a, int b, const Eigen::Matrix3d& B) {
  K.block[K.find(a, a)] += B;
  K.block[K.find(b, b)] += B;
  K.block[K.find(a, b)] -= B;
  K.block[K.find(b, a)] -= B;
}

}  // namespace

double energy(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x) {
  double sum = 0;
  for (int s = 0; s < springs.E.cols(); ++s) {
    const double stretch = (x.col(springs.E(0, s)) - x.col(springs.E(1, s))).norm() - rest_length(s);
    sum += springs.stiffness(s) * stretch * stretch / 2;
  }
  return sum;
}

void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    const double length = l.norm();
    if (length == 0) continue;
    const Eigen::Vector3d force = springs.stiffness(s) * (1 - rest_length(s) / length) * l;
    f.col(a) -= force;
    f.col(b) += force;
  }
}

void add_hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                 BlockMatrix& K) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    const double length = l.norm();
    if (length == 0) continue;
    const Eigen::Vector3d n = l / length;
    const double transverse = std::max(0.0, 1 - rest_length(s) / length);
    add_pair(K, a, b,
             springs.stiffness(s) *
                 (transverse * Eigen::Matrix3d::Identity() + (1 - transverse) * n * n.transpose()));
  }
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

void add_damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale, BlockMatrix& K) {
  for (int s = 0; s < springs.E.cols(); ++s) {
    const int a = springs.E(0, s), b = springs.E(1, s);
    const Eigen::Vector3d l = x.col(a) - x.col(b);
    if (const double squared = l.squaredNorm(); squared > 0)
      add_pair(K, a, b, scale * springs.damping / squared * l * l.transpose());
  }
}

}  // namespace testbed
