#include "meshing/algebra/gauss_seidel.h"

#include <Eigen/LU>

#include "meshing/algebra/subdomains.h"
#include "meshing/algebra/vectors.h"

namespace testbed::meshing {
namespace {

struct Rows {
  const int *start, *column, *diagonal;
  const float *block, *inverse;
};

[[gnu::always_inline]] inline void subtract_product(const float* block, const Float4& q, Float4& rest) {
  const auto column_of = [&](int c) { return *reinterpret_cast<const Float4*>(block + 3 * c); };
  rest -= column_of(0) * q[0] + column_of(1) * q[1] + column_of(2) * q[2];
}

/// rest -= blocks from begin to end times x.
[[gnu::always_inline]] inline void subtract_row(const Rows& A, int begin, int end, const Float4* x,
                                                Float4& rest) {
  for (int k = begin; k < end; ++k)
    subtract_product(A.block + 9 * static_cast<std::ptrdiff_t>(k), x[A.column[k]], rest);
}

[[gnu::always_inline]] inline void solve_row(const Rows& A, int i, const Float4& rest, Float4* x) {
  const Float4 negative = Float4{} - rest;
  Float4 solution{};
  subtract_product(A.inverse + 9 * static_cast<std::ptrdiff_t>(i), negative, solution);
  solution[3] = 0;
  x[i] = solution;
}

TESTBED_EVERY_WIDTH void sweep_rows_down(const Rows& A, int begin, int end, const Float4* r, Float4* z) {
  for (int i = begin; i < end; ++i) {
    Float4 rest = r[i];
    subtract_row(A, A.start[i], A.diagonal[i], z, rest);
    solve_row(A, i, rest, z);
  }
}

TESTBED_EVERY_WIDTH void residual_of_rows(const Rows& A, int begin, int end, const Float4* z, Float4* d) {
  for (int i = begin; i < end; ++i) {
    Float4 rest{};
    subtract_row(A, A.diagonal[i] + 1, A.start[i + 1], z, rest);
    rest[3] = 0;
    d[i] = rest;
  }
}

TESTBED_EVERY_WIDTH void sweep_rows_up(const Rows& A, int begin, int end, const Float4* r, Float4* z) {
  for (int i = end - 1; i >= begin; --i) {
    Float4 rest = r[i];
    subtract_row(A, A.start[i], A.diagonal[i], z, rest);
    subtract_row(A, A.diagonal[i] + 1, A.start[i + 1], z, rest);
    solve_row(A, i, rest, z);
  }
}

Rows rows_of(const BlockMatrix& pattern, const std::vector<float>& blocks,
             const std::vector<float>& inverse) {
  return {pattern.row_start.data(), pattern.column.data(), pattern.diagonal.data(), blocks.data(),
          inverse.data()};
}

const Float4* nodes(const PaddedField& u) {
  return reinterpret_cast<const Float4*>(u.data());
}
Float4* nodes(PaddedField& u) {
  return reinterpret_cast<Float4*>(u.data());
}

}  // namespace

GaussSeidel::GaussSeidel(const BlockMatrix& pattern, const std::vector<float>& blocks,
                         std::vector<int> first_row, const PaddedField& added)
    : pattern_(pattern),
      blocks_(blocks),
      first_row_(std::move(first_row)),
      inverse_(9 * pattern.diagonal.size() + 3) {
  for (std::size_t i = 0; i < pattern.diagonal.size(); ++i) {
    Eigen::Matrix3d D =
        Eigen::Matrix3f::Map(&blocks[9 * static_cast<std::size_t>(pattern.diagonal[i])]).cast<double>();
    if (added.size() > 0) D.diagonal() += added.col(static_cast<Eigen::Index>(i)).head<3>().cast<double>();
    Eigen::Matrix3f::Map(&inverse_[9 * i]) = D.inverse().cast<float>();
  }
}

/// Calls visit(first row, last row + 1) for each subdomain, in their order or backwards.
template <class Visit>
void GaussSeidel::for_each_part(bool is_backwards, const Visit& visit) const {
  const auto part = [&](int subdomain) { visit(first_row_[subdomain], first_row_[subdomain + 1]); };
  if (first_row_[1] == first_row_.back())
    part(0);
  else if (is_backwards)
    for_each_subdomain_backwards(part);
  else
    for_each_subdomain(part);
}

void GaussSeidel::sweep_down(const PaddedField& r, PaddedField& z) const {
  z.setZero(4, r.cols());
  const Rows A = rows_of(pattern_, blocks_, inverse_);
  for_each_part(false, [&](int begin, int end) { sweep_rows_down(A, begin, end, nodes(r), nodes(z)); });
}

void GaussSeidel::residual_of_sweep(const PaddedField& z, PaddedField& d) const {
  d.setZero(4, z.cols());
  const Rows A = rows_of(pattern_, blocks_, inverse_);
  for_each_chunk(pattern_.rows(), [&](Eigen::Index begin, Eigen::Index end) {
    residual_of_rows(A, static_cast<int>(begin), static_cast<int>(end), nodes(z), nodes(d));
  });
}

void GaussSeidel::sweep_up(const PaddedField& r, PaddedField& z) const {
  const Rows A = rows_of(pattern_, blocks_, inverse_);
  for_each_part(true, [&](int begin, int end) { sweep_rows_up(A, begin, end, nodes(r), nodes(z)); });
}

}  // namespace testbed::meshing
