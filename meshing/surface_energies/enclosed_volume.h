// The volume that a surface encloses, a bag of a target volume [paper 3.3, Hirota et al. 1999].
#pragma once

#include <Eigen/Core>

namespace testbed::meshing {

/// Volume V (m3) enclosed by the triangles F at positions x, and dV/dx, 3 x m, m the nodes up to the
/// last one of F: a third of the area vector A n of each triangle to each vertex.
double volume_and_gradient(const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient);

/// Energy (J) 1/2 P (V - V_1)^2 / V_1 [(7)] of the volume V enclosed by the triangles
/// F at positions x (m), with pressure coefficient P (Pa) and target volume V_1 (m3).
double volume_energy(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x);

/// f -= gradient of the energy (N) [(7)]: on each triangle P (V_1 - V)/V_1 A n, a third to each vertex.
void add_volume_forces(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                       Eigen::Matrix3Xd& f);

/// g (N^1/2 m^-1/2), 3 x m like dV/dx, of the Hessian's positive semidefinite part g g^T = P/V_1
/// (dV/dx)(dV/dx)^T. What is left out, P (V - V_1)/V_1 d2V/dx2, has eigenvalues of both signs and vanishes at
/// the target.
Eigen::Matrix3Xd volume_stiffness_root(double P, double target, const Eigen::Matrix3Xi& F,
                                       const Eigen::Matrix3Xd& x);

/// y += g g^T p, 3 x n.
void add_rank_one(const Eigen::Matrix3Xd& g, const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y);

/// y += factor d2V/dx2 p, 3 x n; V the volume enclosed by F at positions x.
void add_volume_curvature(double factor, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                          const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y);

/// A triangle's part of the volume and its derivatives by the positions of its n = 3 or 6 nodes.
struct EnclosedVolume {
  double volume = 0;          ///< m3
  Eigen::Matrix3Xd gradient;  ///< 3 x n (m2)
  Eigen::MatrixXd hessian;    ///< 3 n x 3 n (m)
};

/// V = 1/3 integral of det(x, dx/dr, dx/ds) over the triangle's parameters r, s.
/// @param x  3 x n positions (m): corners, middles of 01, 12, 20
EnclosedVolume enclosed_volume(const Eigen::Matrix3Xd& x);

}  // namespace testbed::meshing
