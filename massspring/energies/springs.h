// Damped springs [paper eq. 1]. Equations are those of massspring/README.md.
#pragma once

#include <Eigen/Core>

#include "meshing/algebra/block_matrix.h"
#include "meshing/base/choices.h"

namespace testbed::massspring {

struct Springs {
  Eigen::Matrix2Xi E;         ///< 2 x n_springs node pairs
  Eigen::VectorXd stiffness;  ///< k_s (N/m)
  double damping = 0;         ///< k_d of every spring (N s/m)
  SpringLaw law = SpringLaw::Hooke;
  /// Where the springs of each subdomain begin [subdomains.h], those along the surface, then those inside:
  /// 2 n_subdomains + 1. Empty where they are in any order.
  std::vector<int> first = {};
};

/// Energy of all springs (J) [(3), (6)]; rest lengths r (m), positions x (3 x n, m).
double energy(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x);

/// f_a -= t(|l|) l/|l|, f_b the opposite (N) [(2)], t the tension, l = x_a - x_b.
/// A spring of no length has no direction and exerts no force.
void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f);

/// A matrix over the nodes made of one block B = u u^T + w I per spring: B in both diagonal blocks of its
/// nodes, -B between them. Column s holds u and w (N/m).
using SpringBlocks = Eigen::Matrix4Xd;

/// Hessian of the energy (N/m) times a scale: B = t' n n^T + t/|l| (I - n n^T), n = l/|l|; projected, t is
/// not taken below 0 [(4)].
SpringBlocks hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                     double scale = 1, Curvature curvature = Curvature::Projected);

/// -df/dv of the damping forces (N s/m) times a scale: B = k_d n n^T.
SpringBlocks damping_matrix(const Springs& springs, const Eigen::Matrix3Xd& x, double scale = 1);

/// K += B, on and above the diagonal.
void add_blocks(const Springs& springs, const SpringBlocks& B, BlockMatrix& K);

/// K += Hessian of the energy (N/m), on and above the diagonal; K's pattern must hold pairs_of(springs).
void add_hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                 BlockMatrix& K, Curvature curvature = Curvature::Projected);

/// Pairs of nodes that share a spring, 2 x n_springs.
Eigen::Matrix2Xi pairs_of(const Springs& springs);

/// Adds the diagonal blocks of B, one for each node.
void add_diagonal(const Springs& springs, const SpringBlocks& B, std::vector<Eigen::Matrix3d>& diagonal);

/// y += B p without a matrix; 3 x n.
void add_product(const Springs& springs, const SpringBlocks& B, const Eigen::Matrix3Xd& p,
                 Eigen::Matrix3Xd& y);

/// The four sums above in plain loops over the springs, which compilers without vectors run. Sums differ from
/// the others' by rounding, in the order of their terms.
namespace plain {
void add_forces(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                Eigen::Matrix3Xd& f);
SpringBlocks hessian(const Springs& springs, const Eigen::VectorXd& rest_length, const Eigen::Matrix3Xd& x,
                     double scale = 1, Curvature curvature = Curvature::Projected);
void add_diagonal(const Springs& springs, const SpringBlocks& B, std::vector<Eigen::Matrix3d>& diagonal);
void add_product(const Springs& springs, const SpringBlocks& B, const Eigen::Matrix3Xd& p,
                 Eigen::Matrix3Xd& y);
}  // namespace plain

/// f_a -= k_d (mu . n) n, mu = v_a - v_b (N) [(2)].
void add_damping_forces(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v,
                        Eigen::Matrix3Xd& f);

/// sum k_d (mu . n)^2 (W).
double damping_power(const Springs& springs, const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& v);

}  // namespace testbed::massspring
