// A law at one deformation gradient, for tests that know no elements.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "fem_reference/elements/laws.h"

namespace testbed::fem {

/// Per volume at rest; F and P by columns as vectors of 9.
struct ElasticResponse {
  double energy;                  ///< J/m3; infinite where the law has none (det F <= 0)
  Eigen::Matrix3d P;              ///< dW/dF (Pa)
  Eigen::Matrix<double, 9, 9> C;  ///< dP/dF (Pa)
};

/// What LawAt takes a single point for.
struct OnePoint {
  using Vector = double;
  using Real = double;
};

template <ElasticLaw law>
ElasticResponse respond_by(const LameConstants& lame, const Eigen::Matrix3d& F, double s) {
  double H[3][3], P[3][3];
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) H[i][k] = F(i, k) - (i == k);
  const LawAt<law, OnePoint> at(H, s, lame.lambda, lame.mu, lame.kappa);
  ElasticResponse r{at.energy_without_logarithm(), {}, {}};
  at.stress(P);
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) r.P(i, k) = P[i][k];
  if constexpr (law == ElasticLaw::NeoHookean)
    r.energy = at.J > 0 ? r.energy - at.c * at.c * at.c * (lame.mu + lame.lambda / 2) * std::log1p(at.J_1)
                        : std::numeric_limits<double>::infinity();
  typename LawAt<law, OnePoint>::Tangent t;
  at.tangent(1, t);
  // The block between functions of gradients e_k and e_l is that of the columns k and l of P and F.
  for (int k = 0; k < 3; ++k)
    for (int l = 0; l < 3; ++l)
      for (int c = 0; c < 3; ++c)
        for (int d = 0; d < 3; ++d) {
          double entry = t.beta * t.push[c][k] * t.push[d][l] + t.gamma * t.push[c][l] * t.push[d][k];
          if constexpr (law == ElasticLaw::StVenantKirchhoff)
            entry += (c == d ? t.metric[k][l] : 0) + (k == l ? t.B[c][d] : 0);
          else if (c == d && k == l)
            entry += t.shear;
          r.C(3 * k + c, 3 * l + d) = entry;
        }
  return r;
}

inline ElasticResponse respond(ElasticLaw law, const LameConstants& lame, const Eigen::Matrix3d& F,
                               double s) {
  if (law == ElasticLaw::SmallStrain) return respond_by<ElasticLaw::SmallStrain>(lame, F, s);
  if (law == ElasticLaw::NeoHookean) return respond_by<ElasticLaw::NeoHookean>(lame, F, s);
  return respond_by<ElasticLaw::StVenantKirchhoff>(lame, F, s);
}

}  // namespace testbed::fem
