// The part g(J) of the law of coupled springs that acts on volume. The number of its equation is that of
// massspring/README.md.
#pragma once

namespace testbed::massspring {

inline constexpr double kLeastJacobian = 0.1;  ///< J_0: below, g is expanded to second order

/// g' (Pa) of (12), of one patch or of a batch side by side: by value, as references to registers of less
/// alignment forget it.
/// @param lambda, mu  Lame constants (Pa)
template <class Number>
[[gnu::always_inline]] inline Number volume_slope(Number J, Number lambda, double mu) {
  const Number least = Number{} + kLeastJacobian, j = J < least ? least : J;
  const Number half = 0.5 * lambda, c_j = (half + mu) / j;
  return half * j - c_j + (half + c_j / j) * (J - j);
}

/// g'' (Pa), likewise.
template <class Number>
[[gnu::always_inline]] inline Number volume_curvature(Number J, Number lambda, double mu) {
  const Number least = Number{} + kLeastJacobian, j = J < least ? least : J;
  const Number half = 0.5 * lambda;
  return half + (half + mu) / (j * j);
}

}  // namespace testbed::massspring
