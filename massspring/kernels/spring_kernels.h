// The sums over springs of energies/springs.cpp, for registers and caches. That file says in plain loops what
// they are: namespace plain.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "massspring/kernels/spring_laws.h"

namespace testbed::massspring {

/// Springs between nodes in pairs, and where those of each subdomain begin [subdomains.h]: 2 n_subdomains + 1
/// places, or none where they are in any order.
struct SpringPairs {
  const Eigen::Matrix2Xi& E;
  const std::vector<int>& first;
};

/// f_a -= t(|l|) l/|l|, f_b the opposite, l = x_a - x_b: 3 x n (N). Law is Hooke or Definite.
/// @param k, r  stiffness (N/m) and rest length (m) of each spring
template <class Law>
void add_spring_forces(const SpringPairs& springs, const double* k, const double* r,
                       const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f);

/// Columns u and w of each spring's block B = u u^T + w I = scale (t' n n^T + t/l (I - n n^T)), t/l not below
/// `least` (N/m).
template <class Law>
Eigen::Matrix4Xd spring_blocks(const SpringPairs& springs, const double* k, const double* r, double scale,
                               double least, const Eigen::Matrix3Xd& x);

/// Adds each B to the diagonal blocks of its two nodes.
void add_spring_diagonal(const SpringPairs& springs, const Eigen::Matrix4Xd& B,
                         std::vector<Eigen::Matrix3d>& diagonal);

/// y_a += B (p_a - p_b), y_b the opposite; 3 x n.
void add_spring_product(const SpringPairs& springs, const Eigen::Matrix4Xd& B, const Eigen::Matrix3Xd& p,
                        Eigen::Matrix3Xd& y);

}  // namespace testbed::massspring
