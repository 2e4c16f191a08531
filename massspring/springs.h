// Damped linear springs [paper eq. 1].
#pragma once

#include <Eigen/Core>

#include "massspring/block_matrix.h"

namespace testbed {

struct Springs {
  Eigen::Matrix2Xi E;         ///< 2 x n_springs node pairs
  Eigen::VectorXd stiffness;  ///< k_s (N/m)
  double damping = 0;         ///< k_d of every spring (N s/m)
};

/// sum 1/2 k_s (|l| - r)^2 (J), l = x_a - x_b, rest lengths r (m).
double energy(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x);

/// f_a -= k_s (|l| - r) l/|l|, f_b the opposite (N). A spring of no length has no direction and exerts no
/// force.
void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f);

/// K += Hessian of the energy (N/m), -df_a/dx_b = -k_s [n n^T + (1 - r/|l|)(I - n n^T)], n = l/|l|, where 1 -
/// r/|l| is not taken below 0, which keeps K positive semidefinite under compression [method 5].
void add_hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                 BlockMatrix& K);

/// f_a -= k_d (mu . n) n, mu = v_a - v_b (N).
void add_damping_forces(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                        Eigen::Matrix3Xd& f);

/// K += scale times -df/dv of the damping forces.
void add_damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale, BlockMatrix& K);

}  // namespace testbed
