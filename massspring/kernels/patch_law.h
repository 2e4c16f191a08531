// The part g(J) of the law of coupled springs that acts on volume. The number of its equation is that of
// massspring/README.md.
#pragma once

namespace testbed::massspring {

inline constexpr double kLeastJacobian = 0.1;  ///< J_0: below, g is expanded to second order

/// g' (Pa) of (12), of one patch or of a batch side by side.
/// @param lambda, mu  Lame constants (Pa)
template <class Number>
[[gnu::always_inline]] inline Number volume_slope(const Number& J, const Number& lambda, double mu) {
  const Number least = Number{} + kLeastJacobian, j = J < least ? least : J;
  const Number half = 0.5 * lambda, c_j = (half + mu) / j;
  return half * j - c_j + (half + c_j / j) * (J - j);
}

}  // namespace testbed::massspring
