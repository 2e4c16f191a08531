// The volume that a closed surface of straight or curved triangles encloses:
// the potential of a pressure that follows it, per pressure.
#pragma once

#include <Eigen/Core>

namespace testbed::fem {

/// A triangle's part of the volume and its derivatives by the positions of its n = 3 or 6 nodes.
struct EnclosedVolume {
  double volume = 0;          ///< m3
  Eigen::Matrix3Xd gradient;  ///< 3 x n (m2)
  Eigen::MatrixXd hessian;    ///< 3 n x 3 n (m)
};

/// V = 1/3 integral of det(x, dx/dr, dx/ds) over the triangle's parameters r, s.
/// @param x  3 x n positions (m): corners, middles of 01, 12, 20
EnclosedVolume enclosed_volume(const Eigen::Matrix3Xd& x);

}  // namespace testbed::fem
