#include "meshing/base/kd_tree.h"

#include <algorithm>
#include <cassert>
#include <numeric>
#include <tuple>

namespace testbed::meshing {

namespace {
constexpr int kLeafSize = 8;
}

KdTree::KdTree(const Eigen::Matrix3Xd& points)
    : points_(points), order_(points.cols()), leaf_of_(points.cols()), is_removed_(points.cols(), false) {
  std::iota(order_.begin(), order_.end(), 0);
  nodes_.reserve(4 * order_.size() / kLeafSize + 1);
  if (!order_.empty()) build(0, static_cast<int>(order_.size()), -1);
}

void KdTree::build(int begin, int end, int parent) {
  const int node = static_cast<int>(nodes_.size());
  nodes_.push_back({{}, begin, end, parent, -1, end - begin});
  for (int p = begin; p < end; ++p) nodes_[node].box.extend(points_.col(order_[p]));
  if (end - begin <= kLeafSize) {
    for (int p = begin; p < end; ++p) leaf_of_[order_[p]] = node;
    return;
  }
  int axis;
  nodes_[node].box.sizes().maxCoeff(&axis);
  const int middle = (begin + end) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end, [&](int i, int j) {
    return std::pair(points_(axis, i), i) < std::pair(points_(axis, j), j);
  });
  build(begin, middle, node);
  nodes_[node].right = static_cast<int>(nodes_.size());
  build(middle, end, node);
}

std::vector<int> KdTree::nearest(const Eigen::Vector3d& x, int k, const std::function<int(int)>& tie) const {
  using Candidate = std::tuple<double, int, int>;  // squared distance, tie, index
  std::vector<Candidate> best;                     // a heap, the worst on top
  best.reserve(k + 1);
  struct Entry {
    double distance2;
    int node;
  };
  Entry stack[128];
  int n = 0;
  if (n_left() > 0 && k > 0) stack[n++] = {0, 0};
  while (n > 0) {
    const Entry entry = stack[--n];
    const bool is_full = static_cast<int>(best.size()) == k;
    if (is_full && entry.distance2 > std::get<0>(best.front())) continue;
    const Node& node = nodes_[entry.node];
    if (node.right < 0) {
      for (int p = node.begin; p < node.end; ++p) {
        const int i = order_[p];
        if (is_removed_[i]) continue;
        const Candidate candidate{(points_.col(i) - x).squaredNorm(), tie ? tie(i) : 0, i};
        if (static_cast<int>(best.size()) < k) {
          best.push_back(candidate);
          std::push_heap(best.begin(), best.end());
        } else if (candidate < best.front()) {
          std::pop_heap(best.begin(), best.end());
          best.back() = candidate;
          std::push_heap(best.begin(), best.end());
        }
      }
      continue;
    }
    Entry children[2] = {{nodes_[entry.node + 1].box.squaredExteriorDistance(x), entry.node + 1},
                         {nodes_[node.right].box.squaredExteriorDistance(x), node.right}};
    if (children[0].distance2 < children[1].distance2) std::swap(children[0], children[1]);
    for (const Entry& child : children)  // the nearer one is looked at first
      if (nodes_[child.node].n_left > 0) stack[n++] = child;
  }
  std::sort(best.begin(), best.end());
  std::vector<int> indices;
  for (const Candidate& candidate : best) indices.push_back(std::get<2>(candidate));
  return indices;
}

void KdTree::remove(int point) {
  assert(!is_removed_[point]);
  is_removed_[point] = true;
  for (int node = leaf_of_[point]; node >= 0; node = nodes_[node].parent) --nodes_[node].n_left;
}

}  // namespace testbed::meshing
