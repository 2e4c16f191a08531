#include "massspring/kernels/spring_rows.h"

#include <algorithm>

#include "meshing/algebra/vectors.h"

namespace testbed::massspring {
namespace {

using Four = Float4;         // a node
using Eight = Float8;        // two
constexpr int kNodes = 256;  // whose part of a sum is added in single precision

/// @param B, p, y  4 floats per place in a row, per node, per node
TESTBED_EVERY_WIDTH double add_product_of_rows(int n, const int* start, const int* other, const float* B,
                                               const float* p, float* y) {
  const Four* P = reinterpret_cast<const Four*>(p);        // NOLINT(modernize-use-auto): it forgets alignment
  const Eight* block = reinterpret_cast<const Eight*>(B);  // NOLINT(modernize-use-auto)
  Four* Y = reinterpret_cast<Four*>(y);                    // NOLINT(modernize-use-auto)
  double total = 0;
  for (int first = 0; first < n; first += kNodes) {
    Four dot{};
    for (int a = first; a < std::min(n, first + kNodes); ++a) {
      const Four one = P[a];
      const Eight p_a = TESTBED_SHUFFLED(one, one, 0, 1, 2, 3, 0, 1, 2, 3);
      Eight sum{};
      for (int k = start[a]; k < start[a + 1]; k += 2) {
        const Four p_b = P[other[k]], p_c = P[other[k + 1]];
        const Eight d = p_a - TESTBED_SHUFFLED(p_b, p_c, 0, 1, 2, 3, 4, 5, 6, 7), u = block[k / 2];
        Eight product = u * d;  // its fourth lanes are 0, as those of d
        product += TESTBED_SHUFFLED(product, product, 1, 0, 3, 2, 5, 4, 7, 6);
        product += TESTBED_SHUFFLED(product, product, 2, 3, 0, 1, 6, 7, 4, 5);
        const Eight q = u * product + d * TESTBED_SHUFFLED(u, u, 3, 3, 3, 3, 7, 7, 7, 7);
        Y[other[k]] -= TESTBED_SHUFFLED(q, q, 0, 1, 2, 3);
        Y[other[k + 1]] -= TESTBED_SHUFFLED(q, q, 4, 5, 6, 7);
        sum += q;
      }
      Four y_a = Y[a] + TESTBED_SHUFFLED(sum, sum, 0, 1, 2, 3) + TESTBED_SHUFFLED(sum, sum, 4, 5, 6, 7);
      y_a[3] = 0;
      Y[a] = y_a;  // complete: all other springs of node a have been in rows before
      dot += one * y_a;
    }
    for (int lane = 0; lane < 3; ++lane) total += static_cast<double>(dot[lane]);
  }
  return total;
}

}  // namespace

SpringRows::SpringRows(const Eigen::Matrix2Xi& springs, int n_nodes)
    : start_(n_nodes + 1, 0), at_(springs.cols()) {
  const Eigen::RowVectorXi first = springs.colwise().minCoeff(), second = springs.colwise().maxCoeff();
  for (const int a : first) ++start_[a + 1];
  for (int a = 0; a < n_nodes; ++a) start_[a + 1] = start_[a] + (start_[a + 1] + 1) / 2 * 2;
  other_.resize(start_.back());
  for (int a = 0; a < n_nodes; ++a) std::fill(other_.begin() + start_[a], other_.begin() + start_[a + 1], a);
  std::vector<int> end = start_;
  for (size_t s = 0; s < at_.size(); ++s) {
    at_[s] = end[first(s)]++;
    other_[at_[s]] = second(s);
  }
}

Eigen::Matrix4Xf SpringRows::in_rows(const Eigen::Matrix4Xd& B) const {
  Eigen::Matrix4Xf rows = Eigen::Matrix4Xf::Zero(4, other_.size());
  for (size_t s = 0; s < at_.size(); ++s) rows.col(at_[s]) = B.col(s).cast<float>();
  return rows;
}

double SpringRows::add_product(const Eigen::Matrix4Xf& B, const PaddedField& p, PaddedField& y) const {
  return add_product_of_rows(static_cast<int>(start_.size()) - 1, start_.data(), other_.data(), B.data(),
                             p.data(), y.data());
}

}  // namespace testbed::massspring
