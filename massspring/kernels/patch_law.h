// The part g(J) of the law of coupled springs that acts on volume. The number of its equation is that of
// massspring/README.md.
#pragma once

namespace testbed::massspring {

inline constexpr double kLeastJacobian = 0.1;  ///< J_0: below, g is expanded to second order

/// g'' (Pa) of (12), of one patch or of a batch side by side: by value, as references to registers of less
/// alignment forget it.
/// @param J_1  J - 1, which keeps the digits of a small strain
/// @param lambda, mu  Lame constants (Pa)
template <class Number>
[[gnu::always_inline]] inline Number volume_curvature(Number J_1, Number lambda, double mu) {
  const Number least = Number{} + (kLeastJacobian - 1), j = (J_1 < least ? least : J_1) + 1.;
  const Number half = 0.5 * lambda;
  return half + (half + mu) / (j * j);
}

/// g' + mu (Pa), likewise: 0 at rest.
template <class Number>
[[gnu::always_inline]] inline Number volume_slope(Number J_1, Number lambda, double mu) {
  const Number least = Number{} + (kLeastJacobian - 1), j_1 = J_1 < least ? least : J_1;
  return j_1 * (0.5 * lambda * (j_1 + 2.) + mu) / (j_1 + 1.) +
         volume_curvature(J_1, lambda, mu) * (J_1 - j_1);
}

}  // namespace testbed::massspring
