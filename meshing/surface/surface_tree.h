// A tree of boxes over a surface's triangles, for exact distances, inside tests and crossings. Our own, since
// the sampling asks it some million times: CGAL's, with its exact numbers, takes several times as long.
#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <vector>

#include "meshing/base/mesh.h"

namespace testbed::meshing {

/// The surface must be closed and consistently oriented; cavities and several solids are allowed.
class SurfaceTree {
 public:
  explicit SurfaceTree(const SurfaceMesh& surface);

  struct Nearest {
    double distance;        ///< m
    Eigen::Vector3d point;  ///< on the surface (m)
    int triangle;
  };
  Nearest nearest(const Eigen::Vector3d& x) const;

  /// Distance to the surface (m), positive inside and negative outside;
  /// the side by angle-weighted normals [Baerentzen & Aanaes 2005].
  double depth(const Eigen::Vector3d& x) const;

  /// Whether the open segment from a to b meets a triangle. Triangles at the vertices `at_a`, `at_b` (-1 for
  /// none), where the segment ends, do not count.
  bool crosses(const Eigen::Vector3d& a, const Eigen::Vector3d& b, int at_a = -1, int at_b = -1) const;

 private:
  struct Node {
    Eigen::AlignedBox3d box;
    int begin, end;  ///< triangles order_[begin, end)
    int right;       ///< right child (the left one is the next node), -1 at a leaf
  };
  struct Hit;

  void build(int begin, int end);
  Hit find_nearest(const Eigen::Vector3d& x) const;

  SurfaceMesh surface_;
  std::vector<int> order_;
  std::vector<Node> nodes_;
  Eigen::Matrix3Xd face_normals_, vertex_normals_;
  Eigen::Matrix3Xi opposite_;  ///< triangle across the edge from corner c to c + 1
};

}  // namespace testbed::meshing
