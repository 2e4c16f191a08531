// Damped linear springs [paper eq. 1].
#pragma once

#include <Eigen/Core>

#include "massspring/block_matrix.h"
#include "meshing/scene.h"

namespace testbed {

struct Springs {
  Eigen::Matrix2Xi E;         ///< 2 x n_springs node pairs
  Eigen::VectorXd stiffness;  ///< k_s (N/m)
  double damping = 0;         ///< k_d of every spring (N s/m)
  SpringLaw law = SpringLaw::Hooke;
};

/// Energy of all springs (J); rest lengths r (m), positions x (3 x n, m).
double energy(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x);

/// f_a -= t(|l|) l/|l|, f_b the opposite (N), t the tension, l = x_a - x_b. A spring of no length has no
/// direction and exerts no force.
void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f);

/// K += Hessian of the energy (N/m), -df_a/dx_b = -[t' n n^T + t/|l| (I - n n^T)], n = l/|l|, where t is not
/// taken below 0, which keeps K positive semidefinite under compression [method 5].
void add_hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                 BlockMatrix& K);

/// f_a -= k_d (mu . n) n, mu = v_a - v_b (N).
void add_damping_forces(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                        Eigen::Matrix3Xd& f);

/// sum k_d (mu . n)^2 (W).
double damping_power(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v);

/// K += scale times -df/dv of the damping forces.
void add_damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale, BlockMatrix& K);

}  // namespace testbed
