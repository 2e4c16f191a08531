#include "meshing/algebra/single_precision.h"

#include <algorithm>

#include "meshing/algebra/subdomains.h"
#include "meshing/algebra/vectors.h"

/// Lanes x y z 0 of four nodes as y z x 0 and as z x y 0.
#define TESTBED_ROTATED_LEFT(u) TESTBED_SHUFFLED(u, u, 1, 2, 0, 3, 5, 6, 4, 7, 9, 10, 8, 11, 13, 14, 12, 15)
#define TESTBED_ROTATED_RIGHT(u) TESTBED_SHUFFLED(u, u, 2, 0, 1, 3, 6, 4, 5, 7, 10, 8, 9, 11, 14, 12, 13, 15)

namespace testbed::meshing {
namespace {

using Four = Float4;         // a node
using Lanes = Float16;       // four nodes
constexpr int kNodes = 256;  // whose part of a sum is added in single precision
constexpr Eigen::Index kChunk = kNodes / 4;

const Lanes* lanes(const PaddedField& u) {
  return reinterpret_cast<const Lanes*>(u.data());
}
Lanes* lanes(PaddedField& u) {
  return reinterpret_cast<Lanes*>(u.data());
}

/// Sum over all lanes of what visit(k, sum) adds to a register for each k < n.
template <class Visit>
[[gnu::always_inline]] inline double sum_of(Eigen::Index n, const Visit& visit) {
  double total = 0;
  for (Eigen::Index first = 0; first < n; first += kChunk) {
    Lanes sum{};
    for (Eigen::Index k = first; k < std::min(n, first + kChunk); ++k) visit(k, sum);
    for (int lane = 0; lane < 16; ++lane) total += static_cast<double>(sum[lane]);
  }
  return total;
}

TESTBED_EVERY_WIDTH double dot_of(const Lanes* u, const Lanes* w, Eigen::Index n) {
  return sum_of(n, [&](Eigen::Index k, Lanes& sum) TESTBED_INLINE { sum += u[k] * w[k]; });
}

TESTBED_EVERY_WIDTH double multiply_by(const Lanes* diagonal, const Lanes* off_diagonal, const Lanes* r,
                                       Lanes* z, Eigen::Index n) {
  return sum_of(n, [&](Eigen::Index k, Lanes& sum) TESTBED_INLINE {
    const Lanes q = r[k], o = off_diagonal[k];
    const Lanes product =
        diagonal[k] * q + o * TESTBED_ROTATED_LEFT(q) + TESTBED_ROTATED_RIGHT(o) * TESTBED_ROTATED_RIGHT(q);
    z[k] = product;
    sum += q * product;
  });
}

TESTBED_EVERY_WIDTH double advance_by(float alpha, const Lanes* p, const Lanes* Ap, Lanes* x, Lanes* r,
                                      Eigen::Index n) {
  return sum_of(n, [&](Eigen::Index k, Lanes& sum) TESTBED_INLINE {
    x[k] += alpha * p[k];
    const Lanes rest = r[k] - alpha * Ap[k];
    r[k] = rest;
    sum += rest * rest;
  });
}

TESTBED_EVERY_WIDTH void add_scaled_by(float alpha, const Lanes* u, Lanes* y, Eigen::Index n) {
  for (Eigen::Index k = 0; k < n; ++k) y[k] += alpha * u[k];
}

/// Rows begin to end - 1.
/// @param blocks  9 floats each, and three more at the end
TESTBED_EVERY_WIDTH double multiply_blocks(int begin, int end, const int* start, const int* column,
                                           const float* blocks, const float* p, float* y) {
  const Four* P = reinterpret_cast<const Four*>(p);  // NOLINT(modernize-use-auto): it forgets alignment
  Four* Y = reinterpret_cast<Four*>(y);              // NOLINT(modernize-use-auto)
  double total = 0;
  for (int first = begin; first < end; first += kNodes) {
    Four dot{};
    for (int i = first; i < std::min(end, first + kNodes); ++i) {
      Four sum{};
      for (int k = start[i]; k < start[i + 1]; ++k) {
        const Four q = P[column[k]];
        const float* B = blocks + 9 * static_cast<std::ptrdiff_t>(k);
        const auto column_of = [&](int c) { return *reinterpret_cast<const Four*>(B + 3 * c); };
        sum += column_of(0) * q[0] + column_of(1) * q[1] + column_of(2) * q[2];
      }
      sum += Y[i];
      sum[3] = 0;
      Y[i] = sum;
      dot += P[i] * sum;
    }
    for (int lane = 0; lane < 3; ++lane) total += static_cast<double>(dot[lane]);
  }
  return total;
}

TESTBED_EVERY_WIDTH void multiply_by(const float* factor, const Four* p, Four* y, Eigen::Index n) {
  for (Eigen::Index i = 0; i < n; ++i) y[i] = factor[i] * p[i];
}

TESTBED_EVERY_WIDTH void aypx_by(float beta, const Lanes* z, Lanes* p, Eigen::Index n) {
  for (Eigen::Index k = 0; k < n; ++k) p[k] = z[k] + beta * p[k];
}

}  // namespace

void pad(const Eigen::Matrix3Xd& u, double factor, PaddedField& result) {
  result.setZero(4, padded(u.cols()));
  for (Eigen::Index i = 0; i < u.cols(); ++i) result.col(i).head<3>() = (factor * u.col(i)).cast<float>();
}

void add_unpadded(const PaddedField& w, double factor, Eigen::Matrix3Xd& u) {
  for (Eigen::Index i = 0; i < u.cols(); ++i) u.col(i) += factor * w.col(i).head<3>().cast<double>();
}

SymmetricBlocks pad(const std::vector<Eigen::Matrix3d>& blocks) {
  const auto n = static_cast<Eigen::Index>(blocks.size());
  SymmetricBlocks D;
  D.diagonal.setZero(4, padded(n));
  D.off_diagonal.setZero(4, padded(n));
  for (Eigen::Index i = 0; i < n; ++i) {
    const Eigen::Matrix3d& B = blocks[i];
    D.diagonal.col(i).head<3>() = B.diagonal().cast<float>();
    D.off_diagonal.col(i).head<3>() = Eigen::Vector3d(B(0, 1), B(1, 2), B(2, 0)).cast<float>();
  }
  return D;
}

double dot(const PaddedField& u, const PaddedField& w) {
  return dot_of(lanes(u), lanes(w), u.cols() / 4);
}

double multiply(const SymmetricBlocks& D, const PaddedField& r, PaddedField& z) {
  z.resize(4, r.cols());
  return multiply_by(lanes(D.diagonal), lanes(D.off_diagonal), lanes(r), lanes(z), r.cols() / 4);
}

double advance(float alpha, const PaddedField& p, const PaddedField& Ap, PaddedField& x, PaddedField& r) {
  return advance_by(alpha, lanes(p), lanes(Ap), lanes(x), lanes(r), r.cols() / 4);
}

void aypx(float beta, const PaddedField& z, PaddedField& p) {
  aypx_by(beta, lanes(z), lanes(p), p.cols() / 4);
}

void multiply(const Eigen::VectorXf& factor, const PaddedField& p, PaddedField& y) {
  y.resize(4, p.cols());
  multiply_by(factor.data(), reinterpret_cast<const Four*>(p.data()), reinterpret_cast<Four*>(y.data()),
              factor.size());
  y.rightCols(y.cols() - factor.size()).setZero();
}

void add_scaled(float alpha, const PaddedField& u, PaddedField& y) {
  add_scaled_by(alpha, lanes(u), lanes(y), u.cols() / 4);
}

double add_product(const std::vector<int>& row_start, const std::vector<int>& column,
                   const std::vector<float>& blocks, const PaddedField& p, PaddedField& y) {
  const auto n_rows = static_cast<Eigen::Index>(row_start.size()) - 1;
  return sum_over_chunks(n_rows, [&](Eigen::Index begin, Eigen::Index end) {
    return multiply_blocks(static_cast<int>(begin), static_cast<int>(end), row_start.data(), column.data(),
                           blocks.data(), p.data(), y.data());
  });
}

}  // namespace testbed::meshing
