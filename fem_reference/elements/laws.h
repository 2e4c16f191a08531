// Elastic laws: energy density, stress and tangent, of one point or of a register of them at once.
#pragma once

#include "meshing/scene/scene.h"

namespace testbed::fem {

/// Saint Venant's and Kirchhoff's is no choice of a scene: another program confirms finite strain by it.
enum class ElasticLaw { SmallStrain, StVenantKirchhoff, NeoHookean };

struct LameConstants {
  double lambda, mu;  ///< Pa
  double kappa = 0;   ///< of volume.local (Pa)
  explicit LameConstants(const Material& m)
      : lambda(m.E * m.nu / ((1 + m.nu) * (1 - 2 * m.nu))), mu(m.E / (2 * (1 + m.nu))) {}
};

/// The laws in terms of the gradient H of the displacement, F = I + H [fem_reference/README.md]. The
/// stress-free state has shrunk by the fraction s in every direction: an eigenstrain -s I, or
/// F = F_elastic (1 - s) at finite strain.
///   small_strain         lambda/2 tr(eps)^2 + mu eps : eps, eps = sym H + s I            [(2)]
///   st_venant_kirchhoff  the same in E = (F^T F - I)/2                                 [(3)]
///   neo_hookean          mu/2 (|F|^2 - 3) + lambda/4 (J^2 - 1) - (mu + lambda/2) ln J    [(4)]
/// The last adds kappa/2 (det F - 1)^2, F the whole: as (8) of the springs, it does not shrink.
/// @tparam Lanes  has the types Vector, a number or a vector of numbers, one of each point, and Real, of these
template <ElasticLaw law, class Lanes>
struct LawAt {
  using V = typename Lanes::Vector;
  using Real = typename Lanes::Real;
  static constexpr bool kIsSmall = law == ElasticLaw::SmallStrain;

  V H[3][3];         ///< of the elastic part
  V E[3][3];         ///< strain of which the energy is quadratic
  V trace;           ///< of E
  V cofactor[3][3];  /// of F
  V J_1, J;          ///< det F - 1, which keeps the digits of a small strain, and det F
  V c;               ///< 1 - s
  V growth;          ///< det F - 1 of the whole F, neo-Hookean
  Real lambda, mu, kappa;

  [[gnu::always_inline]] LawAt(const V (*gradient)[3], const V& s, Real lambda, Real mu, Real kappa)
      : lambda(lambda), mu(mu), kappa(kappa) {
    c = Real(-1) * s + Real(1);
    const V elastic = kIsSmall ? V{} + Real(1) : (V{} + Real(1)) / c;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) H[i][k] = elastic * (i == k ? gradient[i][k] + s : gradient[i][k]);
    if constexpr (law == ElasticLaw::NeoHookean) {
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) {
          const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
          cofactor[i][k] = F(i1, k1) * F(i2, k2) - F(i1, k2) * F(i2, k1);
        }
      // det F - 1 along the first row; the minor of the last two is 1 + m.
      const V m = cofactor_less_one(0, 0);
      J_1 = H[0][0] + m + H[0][0] * m + H[0][1] * cofactor[0][1] + H[0][2] * cofactor[0][2];
      J = J_1 + Real(1);
      growth = c * c * c * J_1 + (c * c * c + Real(-1));
    } else {
      for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k) {
          E[i][k] = Real(0.5) * (H[i][k] + H[k][i]);
          if constexpr (!kIsSmall)
            E[i][k] += Real(0.5) * (H[0][i] * H[0][k] + H[1][i] * H[1][k] + H[2][i] * H[2][k]);
        }
      trace = E[0][0] + E[1][1] + E[2][2];
    }
  }

  [[gnu::always_inline]] V F(int i, int k) const { return i == k ? H[i][k] + Real(1) : H[i][k]; }
  /// cof F - I, without the rounding of the ones.
  [[gnu::always_inline]] V cofactor_less_one(int i, int k) const {
    if (i != k) return cofactor[i][k];
    const int j = (i + 1) % 3, l = (i + 2) % 3;
    return H[j][j] + H[l][l] + (H[j][j] * H[l][l] - H[j][l] * H[l][j]);
  }
  /// Stress that belongs to E.
  [[gnu::always_inline]] V S(int i, int k) const {
    const V twice = Real(2) * mu * E[i][k];
    return i == k ? twice + lambda * trace : twice;
  }

  /// Per volume at rest (J/m3), less (mu + lambda/2) ln J of the neo-Hookean law.
  [[gnu::always_inline]] V energy_without_logarithm() const {
    V W;
    if constexpr (law == ElasticLaw::NeoHookean) {
      W = lambda * Real(0.25) * (J_1 * (J_1 + Real(2))) + mu * (H[0][0] + H[1][1] + H[2][2]);
      for (int i = 0; i < 3; ++i)
        W += Real(0.5) * mu * (H[i][0] * H[i][0] + H[i][1] * H[i][1] + H[i][2] * H[i][2]);
    } else {
      W = Real(0.5) * lambda * (trace * trace);
      for (int i = 0; i < 3; ++i) W += mu * (E[i][0] * E[i][0] + E[i][1] * E[i][1] + E[i][2] * E[i][2]);
    }
    if constexpr (law == ElasticLaw::NeoHookean)
      return c * c * c * W + Real(0.5) * kappa * (growth * growth);
    else
      return kIsSmall ? W : c * c * c * W;
  }

  /// First Piola-Kirchhoff stress (Pa).
  [[gnu::always_inline]] void stress(V (*P)[3]) const {
    V a = c;  // g'(J) + mu of the neo-Hookean law, whose stress is mu (F - cof F) + a cof F
    if constexpr (law == ElasticLaw::NeoHookean)
      a = J_1 * (Real(0.5) * lambda * (J_1 + Real(2)) + mu) / J + kappa * growth;
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        if constexpr (law == ElasticLaw::SmallStrain)
          P[i][k] = S(i, k);
        else if constexpr (law == ElasticLaw::NeoHookean)
          P[i][k] = c * c * (mu * (H[i][k] - cofactor_less_one(i, k)) + a * cofactor[i][k]);
        else
          P[i][k] = c * c * (F(i, 0) * S(0, k) + F(i, 1) * S(1, k) + F(i, 2) * S(2, k));
      }
  }

  /// The tangent between two functions of gradients g_a and g_b, as a 3 x 3 block:
  /// (g_a . metric g_b) I + (g_a . g_b) B + beta h_a h_b^T + gamma h_b h_a^T with h = push g.
  /// Metric and B are multiples of I but for St. Venant-Kirchhoff, and metric alone counts.
  struct Tangent {
    V push[3][3], metric[3][3], B[3][3];
    V beta, gamma, shear;  ///< shear: of the metric
  };
  [[gnu::always_inline]] void tangent(const V& weight, Tangent& t) const {
    const V w = kIsSmall ? weight : c * weight;
    t.shear = w * mu;
    t.beta = w * lambda;
    t.gamma = w * mu;
    V inverse = w;
    if constexpr (law == ElasticLaw::NeoHookean) {
      t.beta = t.beta * (J * J);
      t.gamma = w * (Real(-0.5) * lambda * (J_1 * (J_1 + Real(2))) + mu);
      const V by_kappa = weight * (kappa * c * J);
      t.beta += by_kappa * (Real(2) * growth + Real(1));
      t.gamma -= by_kappa * growth;
      inverse = (V{} + Real(1)) / J;
    }
    for (int i = 0; i < 3; ++i)
      for (int k = 0; k < 3; ++k) {
        if constexpr (law == ElasticLaw::SmallStrain)
          t.push[i][k] = i == k ? V{} + Real(1) : V{};
        else if constexpr (law == ElasticLaw::NeoHookean)
          t.push[i][k] = inverse * cofactor[i][k];
        else {
          t.push[i][k] = F(i, k);
          t.metric[i][k] = w * S(i, k);
          t.B[i][k] = t.shear * (F(i, 0) * F(k, 0) + F(i, 1) * F(k, 1) + F(i, 2) * F(k, 2));
        }
      }
  }
};

}  // namespace testbed::fem
