// Sums over springs by several threads at once, whose results do not depend on the number of threads.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

namespace testbed {

/// The body halved three times: part 0 ... 7 is an eighth, 8 ... 11 a quarter, 12 and 13 are halves, 14 is
/// the whole. A spring belongs to the smallest part that holds all its nodes, so that springs of different
/// parts of one size share none.
inline constexpr int n_parts = 15;

/// Bodies of fewer nodes do not repay a second thread.
inline constexpr int least_parted = 5000;

/// The eighth that each node lies in; X 3 x n.
std::vector<int> eighths(const Eigen::Matrix3Xd& X);

/// The part that holds nodes of eighths a to b, a <= b.
int part_of(int a, int b);

/// Calls visit(part) for each part: those of one size at once, smaller ones first.
template <class Visit>
void for_each_part(const Visit& visit) {
  for (int first = 0, size = 8; size > 0; first += size, size /= 2) {
#pragma omp parallel for schedule(static)
    for (int part = first; part < first + size; ++part) visit(part);
  }
}

/// Calls visit(begin, end) for chunks of 0 ... n - 1, many at once.
template <class Visit>
void for_each_chunk(Eigen::Index n, const Visit& visit) {
  constexpr Eigen::Index kChunk = 2048;
#pragma omp parallel for schedule(static) if (n >= least_parted)
  for (Eigen::Index begin = 0; begin < n; begin += kChunk) visit(begin, std::min(n, begin + kChunk));
}

}  // namespace testbed
