// The surface resists bending across its edges [Grinspun et al. 2003, paper 3.3].
#pragma once

#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

using LargestOf = std::function<double(const Eigen::VectorXd& at_nodes)>;

/// Edge (x_0, x_1) between the triangles (x_0, x_1, x_2) and (x_1, x_0, x_3), oriented outward.
struct Bending {
  Eigen::Matrix4Xi hinges;     ///< x_0 ... x_3
  Eigen::Matrix2Xd area;       ///< of both triangles of each hinge at rest (m2)
  Eigen::VectorXd rest_angle;  ///< theta_0 between the triangles' normals, positive where convex
  Eigen::VectorXd stiffness;   ///< k_b |e|^2 / (A_1 + A_2) of each hinge at rest (J)
};

/// Every edge between two triangles of F at rest positions X (m), with bending stiffness k_b (J).
Bending make_bending(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F, double k_b);

/// Some hinges of it.
Bending part_of(const Bending& bending, const std::vector<int>& hinges);

/// Energy (J) 1/2 stiffness (theta - theta_0)^2 [(9)] of all hinges at positions x (3 x n, m),
/// the difference in (-pi, pi]. Where a triangle has shrunk to t < 1 times a tenth of its
/// area at rest, the difference counts t (2 - t) times, down to nothing: at an angle alone,
/// triangles that crumple would push their nodes the harder the thinner they are, without bound.
double energy(const Bending& bending, const Eigen::Matrix3Xd& x);

/// f -= gradient of the energy (N).
void add_forces(const Bending& bending, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f);

/// K += the Hessian (N/m), on and above the diagonal. If not exact, it is stiffness g g^T with the gradient g of
/// what is squared in the energy, which is positive semidefinite. Where hinges are far from rest that is so much
/// less than the Hessian that Newton's method overshoots. K's pattern must hold pairs_of(bending).
void add_hessian(const Bending& bending, const Eigen::Matrix3Xd& x, BlockMatrix& K,
                 Curvature curvature = Curvature::Projected);

/// The same to what need not have its pattern.
void add_hessian(const Bending& bending, const Eigen::Matrix3Xd& x, SurfaceHessian& H,
                 Curvature curvature = Curvature::Projected);

/// Pairs of nodes that share a hinge, 2 x m.
Eigen::Matrix2Xi pairs_of(const Bending& bending);

/// Mean magnitude (N) of the bending forces of the edges at each of n nodes, 0 where there are none: f_bend
/// of [paper eq. 9]. An edge's force is that on its end.
Eigen::VectorXd mean_bending_forces(const Bending& bending, const Eigen::Matrix3Xd& x);

/// Rest lengths (m) of edges relax for h seconds where the surface is bent [(22), paper eq. 9].
/// @param E  edges, 2 x m
/// @param coefficient  R', the part lost in a second where it is bent most
/// @param largest_of  values at nodes where several processes share the surface; absent: these here
void relax(const Bending& bending, const Eigen::Matrix2Xi& E, double coefficient, double h,
           const Eigen::Matrix3Xd& x, Eigen::Ref<Eigen::VectorXd> rest_length,
           const LargestOf& largest_of = {});

}  // namespace testbed::meshing
