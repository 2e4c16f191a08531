// Nearest points, among a set from which points can be taken away.
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// k-d tree over points (3 x n) that must outlive it. Removing does not rebuild: empty parts are skipped.
class KdTree {
 public:
  explicit KdTree(const Eigen::Matrix3Xd& points);

  /// The (at most) k points left that are nearest to x,
  /// nearest first; equal distances by `tie`, then by index.
  std::vector<int> nearest(const Eigen::Vector3d& x, int k, const std::function<int(int)>& tie = {}) const;

  void remove(int point);
  int n_left() const { return nodes_.empty() ? 0 : nodes_[0].n_left; }

 private:
  struct Node {
    Eigen::AlignedBox3d box;
    int begin, end, parent, right, n_left;  ///< points order_[begin, end); the left child is the next node
  };
  void build(int begin, int end, int parent);

  const Eigen::Matrix3Xd& points_;
  std::vector<int> order_, leaf_of_;
  std::vector<bool> is_removed_;
  std::vector<Node> nodes_;
};

}  // namespace testbed::meshing
