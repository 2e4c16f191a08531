#include "meshing/algebra/subdomains.h"

#include <numeric>

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

}  // namespace

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
