#include "meshing/algebra/subdomains.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <utility>

namespace testbed::meshing {
namespace {

/// Numbers the nodes [begin, end) of a subdomain by its halves across its longest side, and these likewise.
void bisect(const Eigen::Matrix3Xd& X, int* begin, int* end, int leaf, int n_leaves,
            std::vector<int>& result) {
  if (n_leaves == 1) {
    for (const int* i = begin; i != end; ++i) result[*i] = leaf;
    return;
  }
  if (begin == end) return;
  Eigen::Vector3d low = X.col(*begin), high = low;
  for (const int* i = begin; i != end; ++i) {
    low = low.cwiseMin(X.col(*i));
    high = high.cwiseMax(X.col(*i));
  }
  Eigen::Index axis;
  (high - low).maxCoeff(&axis);
  int* const middle = begin + (end - begin) / 2;
  std::nth_element(begin, middle, end,
                   [&](int i, int j) { return X(axis, i) != X(axis, j) ? X(axis, i) < X(axis, j) : i < j; });
  bisect(X, begin, middle, leaf, n_leaves / 2, result);
  bisect(X, middle, end, leaf + n_leaves / 2, n_leaves / 2, result);
}

/// The lowest 21 bits, each at three times its place.
std::uint64_t spread(std::uint64_t bits) {
  bits = (bits | bits << 32) & 0x001f00000000ffff;
  bits = (bits | bits << 16) & 0x001f0000ff0000ff;
  bits = (bits | bits << 8) & 0x100f00f00f00f00f;
  bits = (bits | bits << 4) & 0x10c30c30c30c30c3;
  return (bits | bits << 2) & 0x1249249249249249;
}

}  // namespace

std::vector<int> along_body(const Eigen::Matrix3Xd& points) {
  constexpr int kBits = 21;  // of each coordinate
  const Eigen::Vector3d low = points.rowwise().minCoeff();
  const double side = (points.colwise() - low).maxCoeff(), cells = (1 << kBits) - 1;
  std::vector<std::pair<std::uint64_t, int>> code(points.cols());
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const Eigen::Vector3d place = (points.col(i) - low) * (side > 0 ? cells / side : 0);
    for (int k = 0; k < 3; ++k) code[i].first |= spread(static_cast<std::uint64_t>(place[k])) << k;
    code[i].second = static_cast<int>(i);
  }
  std::sort(code.begin(), code.end());
  std::vector<int> order;
  for (const auto& [_, i] : code) order.push_back(i);
  return order;
}

std::vector<int> leaves_of(const Eigen::Matrix3Xd& X, int n_leaves) {
  std::vector<int> nodes(X.cols()), result(X.cols());
  std::iota(nodes.begin(), nodes.end(), 0);
  bisect(X, nodes.data(), nodes.data() + nodes.size(), 0, n_leaves, result);
  return result;
}

int subdomain_of(int a, int b) {
  int first = 0;
  for (int size = 8; a != b; size /= 2, a /= 2, b /= 2) first += size;
  return first + a;
}

}  // namespace testbed::meshing
