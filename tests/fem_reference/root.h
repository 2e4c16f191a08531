// Roots of functions, for the closed forms of the tests.
#pragma once

namespace testbed::fem {

/// Root of f between low and high, where f changes its sign, by bisection.
template <class F>
double root(F f, double low, double high) {
  const bool is_rising = f(high) > 0;
  for (int k = 0; k < 60; ++k) {
    const double middle = (low + high) / 2;
    ((f(middle) > 0) == is_rising ? high : low) = middle;
  }
  return low;
}

}  // namespace testbed::fem
