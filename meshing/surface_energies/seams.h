// Nodes tied to each other, as by stitches [paper 3.2].
#pragma once

#include "meshing/scene/surface_problem.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Springs of rest length zero.
struct Seams {
  Eigen::Matrix2Xi E;         ///< the nodes that each stitch ties, 2 x m
  Eigen::VectorXd stiffness;  ///< N/m, m
};
Seams seams_of(const SurfaceProblem& problem);

/// Energy (J) sum k/2 |x_a - x_b|^2 at positions x (3 x n, m).
double energy(const Seams& seams, const Eigen::Matrix3Xd& x);

/// f -= gradient of the energy (N).
void add_forces(const Seams& seams, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f);

/// K += Hessian of the energy (N/m), on and above the diagonal, the same at all positions.
void add_hessian(const Seams& seams, const Eigen::Matrix3Xd& x, BlockMatrix& K,
                 Curvature curvature = Curvature::Exact);

/// The same to what need not have its pattern.
void add_hessian(const Seams& seams, const Eigen::Matrix3Xd& x, SurfaceHessian& H,
                 Curvature curvature = Curvature::Exact);

/// Pairs of nodes that are tied, 2 x m.
Eigen::Matrix2Xi pairs_of(const Seams& seams);

}  // namespace testbed::meshing
