// Small strain: the elastic energy to second order about rest [massspring/README.md, section 13].
#pragma once

#include <Eigen/Core>

#include "massspring/kernels/patch_kernels.h"
#include "meshing/algebra/block_matrix.h"
#include "meshing/base/mesh.h"

namespace testbed::massspring {

struct MassSpringModel;
struct State;

/// What linear forces are made of.
struct LinearElasticity {
  BlockMatrix K;  ///< Hessian at rest (N/m) of all but coupled springs; empty where these are all
  Eigen::VectorXd rest_length;  ///< of the independent springs at rest (m)
};

/// Makes the elastic forces of a model linear from now on: f = g - K u, u the displacement from rest and g
/// the forces at rest of lengths that have shrunk [(28)]. Independent springs obey Hooke's law.
void linearise(MassSpringModel& model);

/// y = K u of a linear model, K the Hessian of its energy at rest (N/m), both 3 x n.
void multiply_stiffness(const MassSpringModel& model, const Eigen::Matrix3Xd& u, Eigen::Matrix3Xd& y);

/// Adds factor times the diagonal blocks of K (N/m) to those of each node.
void add_diagonal(const MassSpringModel& model, double factor, std::vector<Eigen::Matrix3d>& blocks);

/// For each node i a bound on the sum over j of |K_ij| (N/m).
Eigen::VectorXd row_sums(const MassSpringModel& model);

/// K in single precision.
struct SingleStiffness {
  std::vector<float> K;
  SinglePatches patches;
};
SingleStiffness single_stiffness(const MassSpringModel& model);

/// y += K p; then p . y.
double add_product(const MassSpringModel& model, const SingleStiffness& single, const PaddedField& p,
                   PaddedField& y);

/// Elastic energy (J) of a linear model at displacements u (3 x n, m), rest lengths as in the state [(28)].
double linear_energy(const MassSpringModel& model, const State& state, const Eigen::Matrix3Xd& u);

/// f += g: what shrunk rest lengths exert on a linear model that has not moved (N), 3 x n.
void add_shrinkage_forces(const MassSpringModel& model, const State& state, Eigen::Matrix3Xd& f);

/// Adds the elastic forces (N) of a linear model at displacements u (3 x n, m).
void add_linear_forces(const MassSpringModel& model, const State& state, const Eigen::Matrix3Xd& u,
                       Eigen::Matrix3Xd& f);

/// Largest |principal value of sym grad u| of the tetrahedra T, X (3 x n, m) at rest, at displacements u.
double largest_linear_strain(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Eigen::Matrix3Xd& u);

/// The same of means over the tetrahedra at a node, by volume: a flat one among them counts little.
double largest_mean_strain(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Eigen::Matrix3Xd& u);

/// Largest |n . (u_a - u_b)| / L of pairs of nodes, L their distance at rest and n its direction.
double largest_linear_strain(const Eigen::Matrix3Xd& X, const Eigen::Matrix2Xi& E, const Eigen::Matrix3Xd& u);

}  // namespace testbed::massspring
