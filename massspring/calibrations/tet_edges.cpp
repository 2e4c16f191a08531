#include <cmath>
#include <map>
#include <utility>

#include "massspring/calibrations/calibrations.h"
#include "meshing/base/geometry.h"

namespace testbed::massspring {

namespace {

/// Springs on tetrahedron edges, each the sum of `stiffness(V, r^2)` over the tetrahedra around it.
template <class Stiffness>
void sum_over_tetrahedra(MassSpringModel& model, const Stiffness& stiffness) {
  const Eigen::Matrix3Xd& X = model.network.X;
  std::map<std::pair<int, int>, double> k;
  for (const auto& t : model.network.T.colwise()) {
    const double V = tet_volume(X, t);
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j)
        k[std::minmax(t[i], t[j])] += stiffness(V, (X.col(t[i]) - X.col(t[j])).squaredNorm());
  }
  Eigen::Matrix2Xi E(2, k.size());
  Eigen::VectorXd values(k.size());
  int s = 0;
  for (const auto& [pair, value] : k) {
    E.col(s) << pair.first, pair.second;
    values[s++] = value;
  }
  set_springs(model, E, values);
  add_dilatation(model);
}

}  // namespace

/// Springs on the edges of the tetrahedra instead of the network's,
/// k = sum_T 5/2 mu V_T / r^2: the affine stiffness of every tetrahedron that is
/// regular [(17), Van Gelder 1998], and a dilatation term at nodes for nu > 1/4.
void calibrate_van_gelder(MassSpringModel& model, const Eigen::Matrix2Xi&) {
  const double mu = lame_of(model.material).mu;
  sum_over_tetrahedra(model, [=](double V, double r2) { return 2.5 * mu * V / r2; });
}

/// As van_gelder with k = sum_T (2 sqrt(2)/25) E_0 a_T and E_0 = 5/2 mu [(17), Lloyd, Szekely & Harders
/// 2007]. The regular tetrahedron of T's volume has the edge a_T.
void calibrate_lloyd(MassSpringModel& model, const Eigen::Matrix2Xi&) {
  const double E_0 = 2.5 * lame_of(model.material).mu;
  sum_over_tetrahedra(model, [=](double V, double) {
    return 2 * std::sqrt(2.) / 25 * E_0 * std::cbrt(6 * std::sqrt(2.) * V);
  });
}

void add_dilatation(MassSpringModel& model) {
  const auto [lambda, mu] = lame_of(model.material);
  constexpr double kRounding = 1e-12;
  if (lambda > mu * (1 + kRounding))
    model.tet_springs = couple_springs(model.network.X, model.network.T, {lambda - mu, 0}, {0, 0, 1});
}

}  // namespace testbed::massspring
