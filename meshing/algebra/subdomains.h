// Sums over springs by several threads at once, whose results do not depend on the number of threads.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <numeric>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Subdomains of a body bisected three times, a binary tree: its leaves 0 ... 7, the quarters 8 ... 11, the
/// halves 12 and 13, and the whole 14. A spring, or a patch of coupled ones, belongs to the smallest that
/// holds all its nodes, so that those of different subdomains of one size share none.
inline constexpr int kSubdomains = 15;

/// Bodies of fewer nodes do not repay a second thread.
inline constexpr int kLeastSubdivided = 5000;

/// An order of points (3 x n) in which near ones follow each other: that of their Morton codes [Morton 1966].
std::vector<int> along_body(const Eigen::Matrix3Xd& points);

/// The leaf that each node lies in, or of more leaves, a power of two, the finer one; X 3 x n (m).
std::vector<int> leaves_of(const Eigen::Matrix3Xd& X, int n_leaves = 8);

/// The smallest subdomain that holds the leaves a to b, a <= b.
int subdomain_of(int a, int b);

/// Calls visit(subdomain) for each subdomain: those of one size at once, smaller ones first.
template <class Visit>
void for_each_subdomain(const Visit& visit) {
  for (int first = 0, size = 8; size > 0; first += size, size /= 2) {
#pragma omp parallel for schedule(static)
    for (int subdomain = first; subdomain < first + size; ++subdomain) visit(subdomain);
  }
}

/// The same, larger ones first.
template <class Visit>
void for_each_subdomain_backwards(const Visit& visit) {
  for (int first = 14, size = 1; size <= 8; size *= 2, first -= size) {
#pragma omp parallel for schedule(static)
    for (int subdomain = first; subdomain < first + size; ++subdomain) visit(subdomain);
  }
}

/// Nodes, or rows of a matrix, that a thread takes at a time.
inline constexpr Eigen::Index kChunkSize = 512;

/// Calls visit(begin, end) for chunks of 0 ... n - 1, many at once.
template <class Visit>
void for_each_chunk(Eigen::Index n, const Visit& visit) {
#pragma omp parallel for schedule(static, 1) if (n >= kLeastSubdivided)
  for (Eigen::Index begin = 0; begin < n; begin += kChunkSize) visit(begin, std::min(n, begin + kChunkSize));
}

/// Sum of what visit(begin, end) returns for each chunk, added in their order.
template <class Visit>
double sum_over_chunks(Eigen::Index n, const Visit& visit) {
  std::vector<double> sums((n + kChunkSize - 1) / kChunkSize);
  for_each_chunk(n,
                 [&](Eigen::Index begin, Eigen::Index end) { sums[begin / kChunkSize] = visit(begin, end); });
  return std::accumulate(sums.begin(), sums.end(), 0.);
}

}  // namespace testbed::meshing
