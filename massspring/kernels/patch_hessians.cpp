#include <Eigen/Eigenvalues>
#include <cmath>

#include "massspring/kernels/patch_kernels.h"
#include "massspring/kernels/patch_lanes.h"
#include "massspring/kernels/patch_law.h"

namespace testbed::massspring {
namespace {

template <int W>
[[gnu::always_inline]] inline Vector<W> root(const Vector<W>& x) {
  double lanes[W];
  for (int i = 0; i < W; ++i) lanes[i] = std::sqrt(number(x, i));
  return load<W>(lanes);
}

/// g' and g'' of the law (Pa).
template <int W>
struct Slopes {
  Vector<W> first, second;
};

/// psi'' is a sum over modes of k (E : dF)^2 beside mu |dF|^2 + g' d2J: that of g'', along C, and what lifts at
/// most five negative eigenvalues to 0 [Smith, de Goes & Kim 2019].
constexpr int kMostModes = 6;
template <int W>
struct Modes {
  int n = 0;
  Vector<W> k[kMostModes];
  Batch<W> E[kMostModes];
};

/// F = U diag(s) V^T with rotations U and V and s descending in size; the last one is negative where det F is.
template <int W>
struct SingularValues {
  Batch<W> U, V;
  Vector<W> s[3];
};

/// Turns two columns in their plane.
template <int W>
[[gnu::always_inline]] inline void rotate(const Vector<W>& c, const Vector<W>& s, Vector<W>* a,
                                          Vector<W>* b) {
  for (int i = 0; i < 3; ++i) {
    const Vector<W> a_i = a[i];
    a[i] = c * a_i - s * b[i];
    b[i] = s * a_i + c * b[i];
  }
}

/// Turns the smaller of two columns to the second place.
template <int W>
[[gnu::always_inline]] inline void order(int i, int j, Batch<W>& A, Batch<W>& V) {
  const auto is_behind = dot<W>(A.column[i], A.column[i]) < dot<W>(A.column[j], A.column[j]);
  for (Batch<W>* M : {&A, &V})
    for (int c = 0; c < 3; ++c) {
      const Vector<W> a = M->column[i][c], b = M->column[j][c];
      M->column[i][c] = is_behind ? b : a;
      M->column[j][c] = is_behind ? -a : b;
    }
}

/// Columns are rotated against each other until they are orthogonal [Hestenes 1958], which is exact to
/// rounding however small one is beside the others.
template <int W>
[[gnu::always_inline]] inline SingularValues<W> singular_values(const Batch<W>& F) {
  constexpr double kOrthogonal = 1e-28;  // squared cosine
  constexpr int kMaxSweeps = 20;
  const Vector<W> zero{}, one = zero + 1.;
  SingularValues<W> result;
  Batch<W>&A = result.U, &V = result.V;
  A = F;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) V.column[j][i] = i == j ? one : zero;
  bool is_orthogonal = false;
  for (int sweep = 0; sweep < kMaxSweeps && !is_orthogonal; ++sweep) {
    is_orthogonal = true;
    for (int k = 0; k < 3; ++k) {
      Vector<W>*const a = A.column[(k + 1) % 3], *const b = A.column[(k + 2) % 3];
      const Vector<W> ab = dot<W>(a, b), aa = dot<W>(a, a), bb = dot<W>(b, b), d = bb - aa;
      const auto is_skew = ab * ab > kOrthogonal * (aa * bb);
      const Vector<W> size = root<W>(d * d + 4. * (ab * ab)), towards = 2. * ab;
      const Vector<W> t = is_skew ? (d < zero ? towards / (d - size) : towards / (d + size)) : zero;
      const Vector<W> c = one / root<W>(one + t * t), s = c * t;
      rotate<W>(c, s, a, b);
      rotate<W>(c, s, V.column[(k + 1) % 3], V.column[(k + 2) % 3]);
      for (int i = 0; i < W; ++i) is_orthogonal &= number(t, i) == 0;
    }
  }
  order(0, 1, A, V);
  order(0, 2, A, V);
  order(1, 2, A, V);
  Vector<W>*const u = A.column[0], *const w = A.column[1];
  result.s[0] = root<W>(dot<W>(u, u));
  result.s[1] = root<W>(dot<W>(w, w));
  for (int i = 0; i < 3; ++i) u[i] = result.s[0] > zero ? u[i] / result.s[0] : (i == 0 ? one : zero);
  // Any direction across the first, where F leaves the second one open [Duff et al. 2017].
  const Vector<W> sign = u[2] < zero ? -one : one, a = -one / (sign + u[2]);
  const Vector<W> across[] = {one + sign * u[0] * u[0] * a, sign * u[0] * u[1] * a, -sign * u[0]};
  for (int i = 0; i < 3; ++i) w[i] = result.s[1] > zero ? w[i] / result.s[1] : across[i];
  Vector<W> last[3];
  cross<W>(u, w, last);
  result.s[2] = dot<W>(last, A.column[2]);
  for (int i = 0; i < 3; ++i) A.column[2][i] = last[i];
  return result;
}

/// psi'' in the basis u_k v_k^T of F's singular vectors, by its eigenvalues.
[[gnu::noinline]] Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> stretch_modes(const Eigen::Vector3d& s,
                                                                               double dg, double ddg,
                                                                               double mu) {
  const Eigen::Vector3d c(s[1] * s[2], s[2] * s[0], s[0] * s[1]);
  Eigen::Matrix3d block = mu * Eigen::Matrix3d::Identity() + ddg * c * c.transpose();
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    block(i, j) += dg * s[k];
    block(j, i) += dg * s[k];
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(block);
}

/// The least pivot of that block, which is positive where it is definite.
template <int W>
[[gnu::always_inline]] inline Vector<W> least_pivot(const Vector<W>* s, const Slopes<W>& g, double mu) {
  const Vector<W> c[] = {s[1] * s[2], s[2] * s[0], s[0] * s[1]};
  const Vector<W> m00 = mu + g.second * c[0] * c[0], m01 = g.second * c[0] * c[1] + g.first * s[2],
                  m02 = g.second * c[0] * c[2] + g.first * s[1], m11 = mu + g.second * c[1] * c[1],
                  m12 = g.second * c[1] * c[2] + g.first * s[0], m22 = mu + g.second * c[2] * c[2];
  const Vector<W> p11 = m11 - m01 * m01 / m00, p12 = m12 - m01 * m02 / m00, p22 = m22 - m02 * m02 / m00;
  const Vector<W> last = p22 - p12 * p12 / p11, least = p11 < last ? p11 : last;
  return m00 < least ? m00 : least;
}

/// Adds what lifts the negative eigenvalues of psi'' to 0. In the basis u_i v_j^T of F's singular vectors
/// psi'' has a 3 x 3 block of stretches, and for each pair of axes i, j a twist and a flip with eigenvalues
/// mu +- g' s_k.
template <int W>
[[gnu::always_inline]] inline void add_projection(const Batch<W>& F, const Slopes<W>& g, double mu,
                                                  Modes<W>& modes) {
  const SingularValues<W> of = singular_values<W>(F);
  const Vector<W> zero{};
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    const Vector<W> turning = g.first * of.s[k], size = turning < zero ? -turning : turning;
    const Vector<W> excess = 0.5 * (size - mu);
    modes.k[modes.n] = excess > zero ? excess : zero;
    Batch<W>& E = modes.E[modes.n++];
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) {
        const Vector<W> back = of.U.column[j][r] * of.V.column[i][c];
        E.column[c][r] = of.U.column[i][r] * of.V.column[j][c] + (turning < zero ? -back : back);
      }
  }
  const Vector<W> least = least_pivot<W>(of.s, g, mu);
  constexpr int kMost = 2;  // negative stretches: their sum with the third is positive
  double stiffness[kMost][W] = {}, direction[kMost][3][W] = {};
  int n = 0;
  for (int lane = 0; lane < W; ++lane) {
    if (number(least, lane) > 0) continue;
    const Eigen::Vector3d s(number(of.s[0], lane), number(of.s[1], lane), number(of.s[2], lane));
    const auto eigen = stretch_modes(s, number(g.first, lane), number(g.second, lane), mu);
    for (int m = 0; m < kMost && eigen.eigenvalues()[m] < 0; ++m) {
      stiffness[m][lane] = -eigen.eigenvalues()[m];
      for (int k = 0; k < 3; ++k) direction[m][k][lane] = eigen.eigenvectors()(k, m);
      n = std::max(n, m + 1);
    }
  }
  for (int m = 0; m < n; ++m) {
    modes.k[modes.n] = load<W>(stiffness[m]);
    Batch<W>& E = modes.E[modes.n++];
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) {
        E.column[c][r] = zero;
        for (int k = 0; k < 3; ++k)
          E.column[c][r] += load<W>(direction[m][k]) * of.U.column[k][r] * of.V.column[k][c];
      }
  }
}

#ifdef TESTBED_HAS_VECTORS
/// The numbers of each lane side by side.
[[gnu::always_inline]] inline void transpose(const Double4* in, Double4* out) {
  const Double4 even = TESTBED_SHUFFLED(in[0], in[1], 0, 4, 2, 6),
                odd = TESTBED_SHUFFLED(in[0], in[1], 1, 5, 3, 7),
                even_2 = TESTBED_SHUFFLED(in[2], in[3], 0, 4, 2, 6),
                odd_2 = TESTBED_SHUFFLED(in[2], in[3], 1, 5, 3, 7);
  out[0] = TESTBED_SHUFFLED(even, even_2, 0, 1, 4, 5);
  out[1] = TESTBED_SHUFFLED(odd, odd_2, 0, 1, 4, 5);
  out[2] = TESTBED_SHUFFLED(even, even_2, 2, 3, 6, 7);
  out[3] = TESTBED_SHUFFLED(odd, odd_2, 2, 3, 6, 7);
}
[[gnu::always_inline]] inline void transpose(const Double8* in, Double8* out) {
  Double8 pair[8], four[8];
  for (int k = 0; k < 8; k += 2) {
    pair[k] = TESTBED_SHUFFLED(in[k], in[k + 1], 0, 8, 2, 10, 4, 12, 6, 14);
    pair[k + 1] = TESTBED_SHUFFLED(in[k], in[k + 1], 1, 9, 3, 11, 5, 13, 7, 15);
  }
  for (int k = 0; k < 8; k += 4)
    for (int i = 0; i < 2; ++i) {
      four[k + i] = TESTBED_SHUFFLED(pair[k + i], pair[k + 2 + i], 0, 1, 8, 9, 4, 5, 12, 13);
      four[k + 2 + i] = TESTBED_SHUFFLED(pair[k + i], pair[k + 2 + i], 2, 3, 10, 11, 6, 7, 14, 15);
    }
  for (int k = 0; k < 4; ++k) {
    out[k] = TESTBED_SHUFFLED(four[k], four[4 + k], 0, 1, 2, 3, 8, 9, 10, 11);
    out[4 + k] = TESTBED_SHUFFLED(four[k], four[4 + k], 4, 5, 6, 7, 12, 13, 14, 15);
  }
}

/// Adds a block of each lane, by columns, to that at its place.
template <int W>
[[gnu::always_inline]] inline void add_blocks(const Vector<W>* B, const int* at, Eigen::Matrix3d* block) {
  Vector<W> lanes[8];
  for (int k = 0; k < 8; k += W) transpose(B + k, lanes + k);
  for (int i = 0; i < W; ++i) {
    double* const there = block[at[i]].data();
    for (int k = 0; k < 8; k += W) *reinterpret_cast<Vector<W>*>(there + k) += lanes[k + i];
    there[8] += B[8][i];
  }
}
#else
template <int W>
[[gnu::always_inline]] inline void add_blocks(const double* B, const int* at, Eigen::Matrix3d* block) {
  for (int k = 0; k < 9; ++k) block[*at].data()[k] += B[k];
}
#endif

/// A b.
template <int W>
[[gnu::always_inline]] inline void multiply(const Batch<W>& A, const Vector<W>* b, Vector<W>* y) {
  for (int i = 0; i < 3; ++i) y[i] = A.column[0][i] * b[0] + A.column[1][i] * b[1] + A.column[2][i] * b[2];
}

/// With d2J (b_r, b_e) = -[F (b_r x b_e)]_x a block is
///   V (mu b_r . b_e - g' [F (b_r x b_e)]_x + sum_m k_m (E_m b_r) (E_m b_e)^T).
/// @param room  for E_m b_e of all entries of a batch
template <int W>
[[gnu::always_inline]] inline void add_hessians_by(int begin, int end, const PatchBatches& batches,
                                                   const PatchArrays& of, const Double4* u,
                                                   Curvature curvature, const int* at, Eigen::Matrix3d* block,
                                                   double* room) {
  for (int batch = begin; batch < end; ++batch)
    for (int lane = 0; lane < kBatchSize; lane += W) {
      const Part<W> part = part_of<W>(batches, batch, lane);
      const Strain<W> strain = strain_of<W>(measure<W>(batches, batch, part, of, u));
      const Batch<W>& F = strain.F;
      Modes<W> modes;
      modes.n = 1;
      modes.E[0] = strain.C;
      const Vector<W> lambda = load<W>(of.lambda + part.first, part.n);
      const Slopes<W> g{volume_slope(strain.J_1, lambda, of.mu) - of.mu,
                        volume_curvature(strain.J_1, lambda, of.mu)};
      modes.k[0] = g.second;
      if (curvature == Curvature::Projected) add_projection<W>(F, g, of.mu, modes);
      Vector<W> V = load<W>(of.volume + part.first, part.n);
      if (of.scale) V = V * load<W>(of.scale + part.first, part.n);
      const Vector<W> turning = V * g.first, stretching = V * of.mu;

      const int n = batches.start[batch + 1] - batches.start[batch];
      const double* const b_of = batches.b.data() + 3 * kBatchSize * batches.start[batch] + lane;
      Vector<W>* const moved = reinterpret_cast<Vector<W>*>(room);  // NOLINT(modernize-use-auto)
      const auto vector_of = [&](int e, Vector<W>* b) TESTBED_INLINE {
        for (int j = 0; j < 3; ++j) b[j] = load<W>(b_of + kBatchSize * (3 * e + j));
      };
      for (int e = 0; e < n; ++e) {
        Vector<W> b[3];
        vector_of(e, b);
        for (int m = 0; m < modes.n; ++m) multiply<W>(modes.E[m], b, moved + 3 * (modes.n * e + m));
      }
      const int* place = at + kBatchSize * batches.pair_start[batch] + lane;
      for (int r = 0; r < n; ++r) {
        Vector<W> b_r[3], stretched[3], pushed[3 * kMostModes];
        vector_of(r, b_r);
        for (int i = 0; i < 3; ++i) stretched[i] = stretching * b_r[i];
        for (int m = 0; m < modes.n; ++m)
          for (int i = 0; i < 3; ++i) pushed[3 * m + i] = V * modes.k[m] * moved[3 * (modes.n * r + m) + i];
        Batch<W> turned;  // b_e to -V g' F (b_r x b_e)
        for (int j = 0; j < 3; ++j) {
          const int k = (j + 1) % 3, l = (j + 2) % 3;
          for (int i = 0; i < 3; ++i)
            turned.column[j][i] = turning * (F.column[l][i] * b_r[k] - F.column[k][i] * b_r[l]);
        }
        for (int e = r; e < n; ++e, place += kBatchSize) {
          Vector<W> b_e[3], w[3], B[9];
          vector_of(e, b_e);
          multiply<W>(turned, b_e, w);
          const Vector<W>* const moved_e = moved + 3 * modes.n * e;
          for (int c = 0; c < 3; ++c)
            for (int i = 0; i < 3; ++i) B[3 * c + i] = pushed[i] * moved_e[c];
          for (int m = 1; m < modes.n; ++m)
            for (int c = 0; c < 3; ++c)
              for (int i = 0; i < 3; ++i) B[3 * c + i] += pushed[3 * m + i] * moved_e[3 * m + c];
          const Vector<W> along = dot<W>(stretched, b_e);
          for (int c = 0; c < 3; ++c) {
            const int i = (c + 1) % 3, j = (c + 2) % 3;
            B[4 * c] += along;
            B[3 * j + i] -= w[c];
            B[3 * i + j] += w[c];
          }
          add_blocks<W>(B, place, block);
        }
      }
    }
}

}  // namespace

void add_patch_hessians(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                        const Double4* u, Curvature curvature, const int* at, Eigen::Matrix3d* block) {
  int n_most = 0;
  for (int batch = begin; batch < end; ++batch)
    n_most = std::max(n_most, batches.start[batch + 1] - batches.start[batch]);
  std::vector<double> room(3 * kMostModes * kBatchSize * static_cast<std::size_t>(n_most));
  by_width([&](auto width) TESTBED_INLINE {
    add_hessians_by<width>(begin, end, batches, of, u, curvature, at, block, room.data());
  });
}

}  // namespace testbed::massspring
