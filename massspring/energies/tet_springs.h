// Springs coupled within patches of tetrahedra, so that they stand for an isotropic solid up to large strain.
//
// A patch holds nodes j with vectors b_j, sum b_j = 0, and measures one deformation gradient F = sum_j x_j
// b_j^T. Since
//   F^T F = -1/2 sum_jk |x_j - x_k|^2 b_j b_k^T, [(10)]
// its energy V psi(F), psi isotropic, depends on the squared lengths of the springs among its nodes
// alone (and, through det F, on which of two mirror images it is): coupled springs [Delingette 2008, Kikuuwe
// et al. 2009]. Patches of one tetrahedron are P1 elasticity, which is too stiff. Patches that average F over
// the tetrahedra around a node are too soft, those around an edge (around each spring) a little too stiff
// [(11), node- and edge-based smoothed finite elements, Liu et al. 2009]. Any blend of them keeps linear
// fields exact; one with node patches does not lock, because incompressibility then acts on nodes alone.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "massspring/kernels/patch_kernels.h"
#include "meshing/algebra/block_matrix.h"
#include "meshing/base/material.h"

namespace testbed::massspring {

/// Lame constants of a material (Pa).
struct Lame {
  double lambda, mu;
};
/// Poisson's ratios of coupled springs.
constexpr double kLeastNu = 0, kLargestNu = 0.499;
/// @throws std::runtime_error unless E > 0 and nu from kLeastNu to kLargestNu: beyond, the springs would pull
/// where they should push or lock.
Lame lame_of(const Material& material);

/// Patches in compressed storage: patch p has entries first[p] ... first[p + 1] - 1.
struct TetSprings {
  std::vector<int> first;  ///< n_patches + 1
  std::vector<int> node;   ///< node of each entry, ascending in a patch
  Eigen::VectorXd weight;  ///< of each entry's node in the patch's centre of mass; needed by collapses alone
  Eigen::VectorXd volume;  ///< V of each patch (m3)
  Eigen::VectorXd lambda;  ///< first Lame constant of each patch (Pa)
  double mu = 0;           ///< shear modulus (Pa)
  /// Where the patches of each subdomain begin [subdomains.h], n_subdomains for each kind of patch, and their
  /// end. Empty where they are in any order.
  std::vector<int> subdomain_first = {};
  /// What forces and energies are summed by, and where the batches of each subdomain begin, likewise.
  PatchBatches batches = {};
  std::vector<int> subdomain_batch = {};

  int n_patches() const { return static_cast<int>(volume.size()); }
  /// b_j of an entry of patch p (1/m), which the batches hold.
  Eigen::Vector3d b(int p, int entry) const;
};

/// Parts of the energy that act on the strain of single tetrahedra, and on its averages around edges and
/// around nodes [(13)]. Sum 1.
struct Blend {
  double tetrahedra, edges, nodes;
};
inline constexpr Blend kEdgeCoupled{1, 0, 0};
/// Chosen on shapes and rotated fields that no study is judged by (head, handle, bar:500, sphere_small,
/// circle_knot): error over that of P1 0.18 in the geometric mean, 0.28 for {0.3, 0, 0.7}; within 5 % of that
/// for edges 0.8 to 1.
inline constexpr Blend kNodeAveraged{0, 0.9, 0.1};
/// The nodes' part of a blend that has one, at constrained nodes and at those that share a tetrahedron with them. A
/// patch that would average beyond the body finds less to average over there, and is stiffer. Chosen on 42
/// clamped cases of generated bodies: error over that of P1 at Poisson's ratio 0.25 in the median 0.27 with
/// the part of everywhere else, 0.16 with 0.3, 0.17 with 0.5, whose worst case is above 1.
inline constexpr double kConstrainedNodes = 0.3;

/// Patches of a blend, those of tetrahedra, edges and nodes in this order, each kind along a body that is large
/// enough, and in the order of its subdomains. X 3 x n (m), T 4 x m of positive volume. With node patches,
/// what lambda exceeds mu by acts on them alone [(14)]. Nodes that supports hold or move may be named.
TetSprings couple_springs(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Lame& lame,
                          const Blend& blend, const std::vector<int>& constrained = {});

/// Of the energy that a strain of one tetrahedron alone has, what averages around its edges leave, over what they leave among
/// five equal ones around each edge, at most 1 [README.md, 11]; m numbers. A flat tetrahedron among others of more volume has
/// hardly any left. X 3 x n (m), T 4 x m of positive volume.
Eigen::RowVectorXd parts_left_by_averages(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T);

/// The coupled springs of kEdgeCoupled, a part of each tetrahedron's energy.
TetSprings single_tetrahedra(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Lame& lame,
                             const Eigen::RowVectorXd& parts);

/// Their stiffness at rest (N/m), the second derivative of (12): parts of V (lambda b_i b_j^T + mu b_j b_i^T + mu b_i . b_j 1),
/// b_i the gradients of barycentric coordinates. With parts of 1 it is that of linear elements.
BlockMatrix stiffness_of_tetrahedra(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Lame& lame,
                                    const Eigen::RowVectorXd& parts);

/// Elastic energy (J) at displacements u (3 x n, m), the rest shape of patch p shrunk by scale(p): its energy is
/// scale^3 V psi(F / scale). An empty scale stands for ones.
///   psi(F) = mu/2 (|F|^2 - 3) + g(J), J = det F, [(12)]
///   g(J) = lambda/4 (J^2 - 1) - (mu + lambda/2) ln J for J >= J_0 = 0.1, its second-order expansion about
///   J_0 below.
/// Polyconvex [Ciarlet & Geymonat 1982], so it never softens to collapse; linear elasticity at small strain;
/// finite and turned back towards J > 0 where a patch is crushed or inverted.
double energy(const TetSprings& springs, const Eigen::Matrix3Xd& u, const Eigen::VectorXd& scale = {});

/// Adds the negative gradient of energy (N) to f.
void add_forces(const TetSprings& springs, const Eigen::Matrix3Xd& u, Eigen::Matrix3Xd& f,
                const Eigen::VectorXd& scale = {});

/// Adds the forces (N) that are linear in displacements u about rest.
void add_linear_forces(const TetSprings& springs, const Eigen::Matrix3Xd& u, Eigen::Matrix3Xd& f);

/// Adds factor times the diagonal blocks of the Hessian at rest (N/m) to those of each node.
void add_diagonal(const TetSprings& springs, double factor, std::vector<Eigen::Matrix3d>& blocks);

/// Adds to each node i a bound on the sum over j of |K_ij| (N/m), K the Hessian at rest.
void add_row_sums(const TetSprings& springs, Eigen::VectorXd& sums);

/// The patches in single precision, and y += K p of them, K the Hessian at rest.
SinglePatches single_precision(const TetSprings& springs);
void add_product(const TetSprings& springs, const SinglePatches& single, const PaddedField& p,
                 PaddedField& y);

/// K += Hessian of the energy (N/m), projected patch by patch [Smith, de Goes & Kim 2019], on and above the
/// diagonal; K's pattern holds pairs_of(springs).
void add_hessian(const TetSprings& springs, const Eigen::Matrix3Xd& u, BlockMatrix& K,
                 Curvature curvature = Curvature::Projected, const Eigen::VectorXd& scale = {});

/// Pairs of nodes that share a patch, 2 x m, i < j, ascending, each once.
Eigen::Matrix2Xi pairs_of(const TetSprings& springs);

/// Smallest det F of any patch: not positive when a patch is inverted.
double smallest_jacobian(const TetSprings& springs, const Eigen::Matrix3Xd& u);

/// A quarter of the mass of its tetrahedra for each node (kg); the total is exact.
Eigen::VectorXd lumped_mass(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, double rho);

}  // namespace testbed::massspring
