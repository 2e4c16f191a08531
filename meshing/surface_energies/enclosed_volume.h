// The volume that a surface encloses, and its derivatives.
#pragma once

#include <Eigen/Core>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Triangles of a surface, straight or curved.
struct Faces {
  Eigen::Matrix3Xi F;          ///< corners
  Eigen::Matrix3Xi middles{};  ///< of the edges 01, 12 and 20 where triangles are curved; empty: straight

  bool is_curved() const { return middles.cols() > 0; }
  /// Of triangle t, 3 or 6.
  Eigen::VectorXi nodes(Eigen::Index t) const;
};

/// @param nodes  3 or 6 rows: corners, middles of 01, 12, 20
Faces faces_of(const Eigen::MatrixXi& nodes);

/// Volume V (m3) enclosed by the triangles F at positions x, and dV/dx, 3 x m, m the nodes up to the
/// last one of F: a third of the area vector A n of each triangle to each vertex.
double volume_and_gradient(const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient);

/// The same, also of curved faces.
double volume_and_gradient(const Faces& faces, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient);

/// The volume alone (m3).
double volume_of(const Faces& faces, const Eigen::Matrix3Xd& x);

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
