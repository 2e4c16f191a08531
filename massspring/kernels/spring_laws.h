// The laws of a spring of stiffness k (N/m), length l and rest length r (m): its energy W (J), tension t (N)
// and slope t' (N/m). The numbers of equations are those of massspring/README.md.
#pragma once

namespace testbed::massspring {

/// Hooke's law (3).
struct Hooke {
  static double energy(double k, double l, double r) { return k / 2 * (l - r) * (l - r); }
  static double tension(double k, double l, double r) { return k * (l - r); }
  static double slope(double k, double, double) { return k; }
};

/// The definite law (6): Hooke's where a spring is stretched, stiffer where it is crushed.
struct Definite {
  static double energy(double k, double l, double r) {
    const double q = r / l;
    return l < r ? k * r / 4 * (l + r / 3 * q * q * q - 4 * r / 3) : Hooke::energy(k, l, r);
  }
  static double tension(double k, double l, double r) {
    const double q = r / l, compressed = k * r / 4 * (1 - q * q * q * q), stretched = Hooke::tension(k, l, r);
    return l < r ? compressed : stretched;  // both computed: a loop over springs has no branch
  }
  static double slope(double k, double l, double r) {
    const double q = r / l;
    return l < r ? k * q * q * q * q * q : k;
  }
};

}  // namespace testbed::massspring
