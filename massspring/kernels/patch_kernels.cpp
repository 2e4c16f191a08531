#include "massspring/kernels/patch_kernels.h"

#include "meshing/algebra/vectors.h"

namespace testbed::massspring {
namespace {

/// y += A b, A n x 3.
template <int n>
[[gnu::always_inline]] inline void add_product(const double* A, const double* b, double* y) {
  const double *A0 = A, *A1 = A0 + n, *A2 = A1 + n;
  int i = 0;
  for (; i + 4 <= n; i += 4)
    *reinterpret_cast<Double4*>(y + i) += b[0] * *reinterpret_cast<const Double4*>(A0 + i) +
                                          b[1] * *reinterpret_cast<const Double4*>(A1 + i) +
                                          b[2] * *reinterpret_cast<const Double4*>(A2 + i);
  for (; i < n; ++i) y[i] += b[0] * A0[i] + b[1] * A1[i] + b[2] * A2[i];
}

TESTBED_NARROW void add_blocks(const double* psi, double V, const double* b, int n, const int* at,
                               Eigen::Matrix3d* block) {
  for (int r = 0; r < n; ++r) {
    const double Vb[] = {V * b[3 * r], V * b[3 * r + 1], V * b[3 * r + 2]};
    double row[27] = {};
    add_product<27>(psi, Vb, row);
    for (int e = r; e < n; ++e) add_product<9>(row, b + 3 * e, block[*at++].data());
  }
}

}  // namespace

void add_patch_blocks(const Stiffness& psi, double V, const double* b, int n, const int* at,
                      Eigen::Matrix3d* block) {
  if (kHasVectors)
    add_blocks(psi.data(), V, b, n, at, block);
  else
    plain::add_patch_blocks(psi, V, b, n, at, block);
}

void plain::add_patch_blocks(const Stiffness& psi, double V, const double* b, int n, const int* at,
                             Eigen::Matrix3d* block) {
  const Eigen::Map<const Eigen::Matrix3Xd> B(b, 3, n);
  for (int r = 0; r < n; ++r) {
    const Eigen::Matrix<double, 9, 3> row = (psi * (V * B.col(r))).reshaped(9, 3);
    for (int e = r; e < n; ++e) block[*at++].reshaped() += row * B.col(e);
  }
}

}  // namespace testbed::massspring
