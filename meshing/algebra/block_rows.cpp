#include "meshing/algebra/block_rows.h"

#include "meshing/algebra/vectors.h"

namespace testbed::meshing {
namespace {

/// Lanes of a row and floats of a block, rows of D components.
template <int D>
struct LanesOf {
  typedef Float8 Type;  // NOLINT(modernize-use-using): it forgets alignment
};
template <>
struct LanesOf<3> {
  typedef Float4 Type;  // NOLINT(modernize-use-using)
};
template <int D>
constexpr std::ptrdiff_t kStride = D == 3 ? 4 : 8;

// Of floats anywhere: templates forget how little these types are aligned.
[[gnu::always_inline]] inline void load(const float* from, Float4& lanes) {
  lanes = *reinterpret_cast<const Float4*>(from);
}
[[gnu::always_inline]] inline void load(const float* from, Float8& lanes) {
  lanes = *reinterpret_cast<const Float8*>(from);
}
[[gnu::always_inline]] inline void store(const Float4& lanes, float* to) {
  *reinterpret_cast<Float4*>(to) = lanes;
}
[[gnu::always_inline]] inline void store(const Float8& lanes, float* to) {
  *reinterpret_cast<Float8*>(to) = lanes;
}

/// Adds B x of a block of n columns of m floats; lanes beyond them do not count.
template <int m, int n, class Lanes>
[[gnu::always_inline]] inline void add_block_product(const float* B, const float* x, Lanes& sum) {
  for (int c = 0; c < n; ++c) {
    Lanes column;
    load(B + static_cast<std::ptrdiff_t>(m) * c, column);
    sum += column * x[c];
  }
}

template <int D>
struct Rows {
  typedef typename LanesOf<D>::Type Lanes;  // NOLINT(modernize-use-using): it forgets alignment
  int n;
  const int *start, *column, *diagonal;
  const float *block, *inverse;

  explicit Rows(const BlockRows<D>& A)
      : n(static_cast<int>(A.n_rows())),
        start(A.row_start.data()),
        column(A.column.data()),
        diagonal(A.diagonal.data()),
        block(A.block.data()),
        inverse(A.inverse.data()) {}

  /// Adds the blocks from begin to end times x.
  [[gnu::always_inline]] void add(int begin, int end, const float* x, Lanes& sum,
                                  std::ptrdiff_t ahead = 512) const {
    for (int k = begin; k < end; ++k) {
      const float* const B = block + D * D * static_cast<std::ptrdiff_t>(k);
      TESTBED_PREFETCH(B + ahead);
      add_block_product<D, D>(B, x + kStride<D> * column[k], sum);
    }
  }
  /// y_i = sum, whose padding becomes zero.
  [[gnu::always_inline]] static void set(Lanes sum, int i, float* y) {
    for (int lane = D; lane < kStride<D>; ++lane) sum[lane] = 0;
    store(sum, y + kStride<D> * i);
  }
  /// Adds the inverse of a diagonal block times r to x_i.
  [[gnu::always_inline]] void add_inverse(int i, const Lanes& r, float* x) const {
    Lanes sum;
    load(x + kStride<D> * i, sum);
    add_block_product<D, D>(inverse + D * D * static_cast<std::ptrdiff_t>(i),
                            reinterpret_cast<const float*>(&r), sum);
    set(sum, i, x);
  }
  [[gnu::always_inline]] void multiply(const float* x, float* y) const {
    for (int i = 0; i < n; ++i) {
      Lanes sum{};
      add(start[i], start[i + 1], x, sum);
      set(sum, i, y);
    }
  }
  [[gnu::always_inline]] void multiply_inverse(const float* x, float* y) const {
    for (int i = 0; i < n; ++i) {
      Lanes r;
      load(x + kStride<D> * i, r);
      add_inverse(i, r, y);
    }
  }
  /// x_i += its inverse times what the blocks from begin to end leave of b_i.
  [[gnu::always_inline]] void relax(int i, int begin, int end, const float* b, float* x,
                                    std::ptrdiff_t ahead) const {
    Lanes r, sum{};
    add(begin, end, x, sum, ahead);
    load(b + kStride<D> * i, r);
    add_inverse(i, r - sum, x);
  }
  [[gnu::always_inline]] void sweep_down(const float* b, float* x) const {
    for (int i = 0; i < n; ++i) relax(i, start[i], diagonal[i], b, x, 512);
  }
  [[gnu::always_inline]] void rest_of_sweep(const float* x, float* r) const {
    for (int i = 0; i < n; ++i) {
      Lanes sum{};
      add(diagonal[i] + 1, start[i + 1], x, sum);
      set(Lanes{} - sum, i, r);
    }
  }
  [[gnu::always_inline]] void sweep_up(const float* b, float* x) const {
    for (int i = n - 1; i >= 0; --i) relax(i, start[i], start[i + 1], b, x, -512);
  }
};

template <int D>
struct Followers {
  int n;
  const int *start, *column;
  const float* block;

  explicit Followers(const BodyRows<D>& P)
      : n(static_cast<int>(P.row_start.size()) - 1),
        start(P.row_start.data()),
        column(P.column.data()),
        block(P.block.data()) {}

  [[gnu::always_inline]] void gather(const float* r, float* wrench) const {
    for (int i = 0; i < n; ++i)
      for (int k = start[i]; k < start[i + 1]; ++k) {
        Float8 sum;
        float* const of_body = wrench + kStride<6> * column[k];
        load(of_body, sum);
        add_block_product<6, D>(block + 6 * D * static_cast<std::ptrdiff_t>(k), r + kStride<D> * i, sum);
        store(sum, of_body);
      }
  }
  [[gnu::always_inline]] void add_motion(const float* motion, float* x) const {
    for (int i = 0; i < n; ++i) {
      Float8 sum[D] = {};
      for (int k = start[i]; k < start[i + 1]; ++k) {
        Float8 of_body, force;
        load(motion + kStride<6> * column[k], of_body);
        for (int c = 0; c < D; ++c) {
          load(block + 6 * (D * static_cast<std::ptrdiff_t>(k) + c), force);
          sum[c] += force * of_body;
        }
      }
      for (int c = 0; c < D; ++c)
        x[kStride<D> * i + c] +=
            ((sum[c][0] + sum[c][1]) + (sum[c][2] + sum[c][3])) + (sum[c][4] + sum[c][5]);
    }
  }
};

}  // namespace

// Functions for several widths cannot be templates.
// NOLINTBEGIN(bugprone-macro-parentheses): names of functions take none
#define TESTBED_OF_ROWS(D, name)                                                           \
  TESTBED_EVERY_WIDTH static void name##_##D(const Rows<D>& A, const float* u, float* w) { \
    A.name(u, w);                                                                          \
  }                                                                                        \
  template <>                                                                              \
  void name<D>(const BlockRows<D>& A, const FieldOf<D>& u, FieldOf<D>& w) {                \
    w.setZero(u.rows(), u.cols());                                                         \
    name##_##D(Rows<D>(A), u.data(), w.data());                                            \
  }
// NOLINTEND(bugprone-macro-parentheses)
#define TESTBED_OF_SIZE(D)                                                                               \
  TESTBED_OF_ROWS(D, multiply)                                                                           \
  TESTBED_OF_ROWS(D, multiply_inverse)                                                                   \
  TESTBED_OF_ROWS(D, sweep_down)                                                                         \
  TESTBED_OF_ROWS(D, rest_of_sweep)                                                                      \
  TESTBED_EVERY_WIDTH static void sweep_up_##D(const Rows<D>& A, const float* b, float* x) {             \
    A.sweep_up(b, x);                                                                                    \
  }                                                                                                      \
  template <>                                                                                            \
  void sweep_up<D>(const BlockRows<D>& A, const FieldOf<D>& b, FieldOf<D>& x) {                          \
    sweep_up_##D(Rows<D>(A), b.data(), x.data());                                                        \
  }                                                                                                      \
  TESTBED_EVERY_WIDTH static void gather_##D(const Followers<D>& P, const float* r, float* wrench) {     \
    P.gather(r, wrench);                                                                                 \
  }                                                                                                      \
  template <>                                                                                            \
  void gather<D>(const BodyRows<D>& P, const FieldOf<D>& r, BodyField& wrench) {                         \
    wrench.setZero();                                                                                    \
    gather_##D(Followers<D>(P), r.data(), wrench.data());                                                \
  }                                                                                                      \
  TESTBED_EVERY_WIDTH static void add_motion_##D(const Followers<D>& P, const float* motion, float* x) { \
    P.add_motion(motion, x);                                                                             \
  }                                                                                                      \
  template <>                                                                                            \
  void add_motion<D>(const BodyRows<D>& P, const BodyField& motion, FieldOf<D>& x) {                     \
    add_motion_##D(Followers<D>(P), motion.data(), x.data());                                            \
  }

TESTBED_OF_SIZE(3)
TESTBED_OF_SIZE(6)

}  // namespace testbed::meshing
