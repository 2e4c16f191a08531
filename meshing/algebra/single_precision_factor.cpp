#include "meshing/algebra/single_precision_factor.h"

#include <algorithm>

#include "meshing/algebra/vectors.h"

namespace testbed::meshing {
namespace {

constexpr int kLanes = 8;

/// The pointers of a factor, and room for a supernode's part of a vector.
struct Rows {
  const int* row;
  const float *entry, *inverse;
  float* part;
};

/// x = L^-1 x.
TESTBED_EVERY_WIDTH void solve_down(const SinglePrecisionFactor::Supernode* begin,
                                    const SinglePrecisionFactor::Supernode* end, const Rows& L, float* x) {
  float* const part = L.part;
  for (const SinglePrecisionFactor::Supernode* s = begin; s != end; ++s) {
    std::copy_n(x + s->first, s->n_columns, part);
    std::fill(part + s->n_columns, part + s->height, 0.f);
    for (int j = 0; j < s->n_columns; ++j) {
      const float x_j = x[s->first + j] = part[j] * L.inverse[s->first + j];
      const float* column = L.entry + s->entries + static_cast<std::size_t>(j) * s->height;
      for (int i = j / kLanes * kLanes; i < s->height; i += kLanes)
        *reinterpret_cast<Float8*>(part + i) -= *reinterpret_cast<const Float8*>(column + i) * x_j;
    }
    const int* row = L.row + s->rows;
    for (int i = s->n_columns; i < s->n_rows; ++i) x[*row++] += part[i];
  }
}

/// x = L^-T x.
TESTBED_EVERY_WIDTH void solve_up(const SinglePrecisionFactor::Supernode* begin,
                                  const SinglePrecisionFactor::Supernode* end, const Rows& L, float* x) {
  float* const part = L.part;
  for (const SinglePrecisionFactor::Supernode* s = end; s-- != begin;) {
    std::copy_n(x + s->first, s->n_columns, part);
    const int* row = L.row + s->rows;
    for (int i = s->n_columns; i < s->n_rows; ++i) part[i] = x[*row++];
    std::fill(part + s->n_rows, part + s->height, 0.f);
    for (int j = s->n_columns - 1; j >= 0; --j) {
      const float* column = L.entry + s->entries + static_cast<std::size_t>(j) * s->height;
      Float8 sum{};
      for (int i = j / kLanes * kLanes; i < s->height; i += kLanes)
        sum += *reinterpret_cast<const Float8*>(column + i) * *reinterpret_cast<const Float8*>(part + i);
      float rest = part[j];
      for (int lane = 0; lane < kLanes; ++lane) rest -= sum[lane];
      x[s->first + j] = part[j] = rest * L.inverse[s->first + j];
    }
  }
}

}  // namespace

double SinglePrecisionFactor::solve(const PaddedField& r, PaddedField& z) const {
  int highest = 0;
  for (const Supernode& s : supernodes) highest = std::max(highest, s.height);
  std::vector<float> x(unknown.size()), part(highest);
  for (std::size_t k = 0; k < x.size(); ++k) x[k] = r.data()[unknown[k]];
  const Rows L{row.data(), entry.data(), inverse.data(), part.data()};
  const Supernode* const end = supernodes.data() + supernodes.size();
  solve_down(supernodes.data(), end, L, x.data());
  solve_up(supernodes.data(), end, L, x.data());
  z.setZero(4, r.cols());
  for (std::size_t k = 0; k < x.size(); ++k) z.data()[unknown[k]] = x[k];
  return dot(r, z);
}

Eigen::Matrix3Xd SinglePrecisionFactor::solve(const Eigen::Matrix3Xd& r) const {
  const double size = r.norm();
  PaddedField single, solution;
  pad(r, size > 0 ? 1 / size : 1, single);
  solve(single, solution);
  Eigen::Matrix3Xd x = Eigen::Matrix3Xd::Zero(3, r.cols());
  add_unpadded(solution, size, x);
  return x;
}

}  // namespace testbed::meshing
