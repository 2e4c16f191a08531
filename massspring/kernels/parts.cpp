#include "massspring/kernels/parts.h"

#include <numeric>

namespace testbed::massspring {
namespace {

/// Numbers the nodes [begin, end) of a part by its halves across its longest side, and these likewise.
void halve(const Eigen::Matrix3Xd& X, int* begin, int* end, int eighth, int n_eighths,
           std::vector<int>& result) {
  if (n_eighths == 1) {
    for (const int* i = begin; i != end; ++i) result[*i] = eighth;
    return;
  }
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
  halve(X, begin, middle, eighth, n_eighths / 2, result);
  halve(X, middle, end, eighth + n_eighths / 2, n_eighths / 2, result);
}

}  // namespace

std::vector<int> eighths(const Eigen::Matrix3Xd& X) {
  std::vector<int> nodes(X.cols()), result(X.cols());
  std::iota(nodes.begin(), nodes.end(), 0);
  halve(X, nodes.data(), nodes.data() + nodes.size(), 0, 8, result);
  return result;
}

int part_of(int a, int b) {
  int first = 0;
  for (int size = 8; a != b; size /= 2, a /= 2, b /= 2) first += size;
  return first + a;
}

}  // namespace testbed::massspring
