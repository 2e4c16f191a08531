// Obstacles as signed distances.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "meshing/scene/scene.h"

namespace testbed::meshing {

class RigidBody {
 public:
  /// @param frame  axes of the coordinates that it is asked in, in columns
  /// @throws std::runtime_error when a mesh cannot be read or is not closed
  explicit RigidBody(const Obstacle& obstacle, const Eigen::Matrix3d& frame = Eigen::Matrix3d::Identity());

  struct Gap {
    double distance;         ///< to the body's surface (m), negative inside
    Eigen::Vector3d normal;  ///< out of the body, at the nearest point of its surface
  };
  /// Of a point x at time t. Exact outside; nowhere longer than the way to the surface.
  Gap gap(const Eigen::Vector3d& x, double t) const { return gap_(motion_.empty() ? x : x - translation(t)); }

  Eigen::Vector3d translation(double t) const;

  /// Where the straight way from x at time t to y at time t + h first comes within `least` of it,
  /// as seen from the body: a point at time t + h. Found by steps as long as the gap
  /// [conservative advancement], so that nothing is thin enough to be missed; beside convex bodies, whose gap is convex
  /// along the way, by Newton's, which never pass the first touch either.
  std::optional<Eigen::Vector3d> first_touch(const Eigen::Vector3d& x, const Eigen::Vector3d& y, double t,
                                             double h, double least) const;

  double friction;              ///< Coulomb's coefficient
  std::optional<double> range;  ///< of its barrier (m)
  bool may_overlap;             ///< a body as its motion begins

 private:
  Path motion_;
  bool is_flat_;                                    ///< a half-space, to which gaps are linear
  bool is_convex_;                                  ///< all but meshes
  std::function<Gap(const Eigen::Vector3d&)> gap_;  ///< of a point in the body's frame
};

/// That a body begins outside of obstacles that it may not overlap; it may touch them. What nothing but a support moves
/// may lie inside.
/// @param X  nodes (3 x n, m)
/// @param faces  3 or 6 nodes each, outward
/// @param is_constrained  per node, whether supports hold it
/// @throws std::runtime_error naming obstacle, vertex and depth where it lies deepest
void check_apart(const std::vector<RigidBody>& obstacles, const Eigen::Matrix3Xd& X,
                 const Eigen::MatrixXi& faces, const std::vector<char>& is_constrained);

}  // namespace testbed::meshing
