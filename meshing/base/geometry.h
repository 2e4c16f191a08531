// Tetrahedra and triangles, one at a time.
#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Six times the volume of a tetrahedron abcd (m3), positive where d lies on the side of abc that its normal
/// (b - a) x (c - a) points to.
inline double orientation(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                          const Eigen::Vector3d& d) {
  return (b - a).cross(c - a).dot(d - a);
}

/// Volume (m3) of a tetrahedron between four of the nodes X, 3 x n (m), with the sign of its orientation.
inline double tet_volume(const Eigen::Matrix3Xd& X, const Eigen::Vector4i& tet) {
  return orientation(X.col(tet[0]), X.col(tet[1]), X.col(tet[2]), X.col(tet[3])) / 6;
}

/// Gradients (1/m) of its four barycentric coordinates, finite where its volume, as it rounds, is not zero.
inline Eigen::Matrix<double, 3, 4> barycentric_gradients(const Eigen::Matrix3Xd& X,
                                                         const Eigen::Vector4i& tet) {
  Eigen::Matrix3d edges;
  for (int k = 0; k < 3; ++k) edges.col(k) = X.col(tet[k + 1]) - X.col(tet[0]);
  Eigen::Matrix<double, 3, 4> g;
  g.rightCols<3>() = edges.inverse().transpose();
  if (!g.rightCols<3>().allFinite()) {  // where the determinant rounds to zero and the volume does not
    const auto a = edges.col(0), b = edges.col(1), c = edges.col(2);
    g.rightCols<3>() << b.cross(c), c.cross(a), a.cross(b);
    g.rightCols<3>() /= 6 * tet_volume(X, tet);
  }
  g.col(0) = -g.rightCols<3>().rowwise().sum();
  return g;
}

/// A nearest point on a triangle.
struct OnTriangle {
  Eigen::Vector3d point;    ///< m
  Eigen::Vector3d weights;  ///< its barycentric coordinates
  int feature;  ///< in the triangle (-1), on the edge from corner c to c + 1 (c), or at corner c (3 + c)
};

/// The point of triangle abc nearest to p [Ericson 2005, 5.1.5].
inline OnTriangle nearest_on_triangle(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                                      const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d ab = b - a, ac = c - a, ap = p - a;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap);
  if (d1 <= 0 && d2 <= 0) return {a, {1, 0, 0}, 3};
  const Eigen::Vector3d bp = p - b;
  const double d3 = ab.dot(bp), d4 = ac.dot(bp);
  if (d3 >= 0 && d4 <= d3) return {b, {0, 1, 0}, 4};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) {
    const double w = d1 / (d1 - d3);
    return {a + w * ab, {1 - w, w, 0}, 0};
  }
  const Eigen::Vector3d cp = p - c;
  const double d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d6 >= 0 && d5 <= d6) return {c, {0, 0, 1}, 5};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0 && d2 >= 0 && d6 <= 0) {
    const double w = d2 / (d2 - d6);
    return {a + w * ac, {1 - w, 0, w}, 2};
  }
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0 && d4 >= d3 && d5 >= d6) {
    const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return {b + w * (c - b), {0, 1 - w, w}, 1};
  }
  const double sum = va + vb + vc, scale = 1 / sum;
  return {a + vb * scale * ab + vc * scale * ac, {va / sum, vb / sum, vc / sum}, -1};
}

}  // namespace testbed::meshing
