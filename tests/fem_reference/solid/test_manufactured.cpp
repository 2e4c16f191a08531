// Slopes of the error on a smooth manufactured solution: the reference converges at the rate of its degree.
#include <gtest/gtest.h>

#include <set>
#include <tuple>

#include "fem_reference/elements/laws.h"
#include "fem_reference/solid/elasticity.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// u = d sin(k . x): grad u = d k^T cos, -div sigma = [(lambda + mu) (d . k) k + mu |k|^2 d] sin.
struct Wave {
  Material material;
  Vector3d k, d;
  Vector3d displacement(const Vector3d& x) const { return d * std::sin(k.dot(x)); }
  Matrix3d gradient(const Vector3d& x) const { return d * k.transpose() * std::cos(k.dot(x)); }
  Vector3d body_force(const Vector3d& x) const {
    const LameConstants lame(material);
    return ((lame.lambda + lame.mu) * d.dot(k) * k + lame.mu * k.squaredNorm() * d) * std::sin(k.dot(x));
  }
};

/// On a cube of n^3 boxes of six tetrahedra, its boundary constrained.
FieldError error_on(int n, int degree, const Wave& wave) {
  ElasticSolid solid(box_tets(n, n, n, 1.0 / n), degree);
  std::vector<ConstrainedComponent> constrained;
  std::set<int> boundary(solid.faces().data(), solid.faces().data() + solid.faces().size());
  for (int i : boundary)
    for (int c = 0; c < 3; ++c) constrained.push_back({i, c, wave.displacement(solid.X().col(i))(c)});
  ElasticLoads loads;
  loads.body_force = [&](const Vector3d& x) { return wave.body_force(x); };
  solid.assemble(wave.material, ElasticLaw::SmallStrain, loads, constrained);
  EXPECT_TRUE(solid.solve().is_converged);
  return field_error(
      solid.X(), solid.cells(), solid.displacement(), [&](const Vector3d& x) { return wave.displacement(x); },
      [&](const Vector3d& x) { return wave.gradient(x); });
}

void expect_slopes(int degree, int n, double l2, double h1) {
  constexpr double kWithin = 0.1;  // of the asymptotic slope on these meshes
  const Wave wave{{1000, 0.3, 1, 0}, {2, 1.5, 1}, {1, -0.5, 0.7}};
  const FieldError coarse = error_on(n, degree, wave), fine = error_on(2 * n, degree, wave);
  EXPECT_NEAR(std::log2(coarse.l2 / fine.l2), l2, kWithin);
  EXPECT_NEAR(std::log2(coarse.h1 / fine.h1), h1, kWithin);
}

TEST(Manufactured, LinearElementsHaveSlopesTwoAndOne) {
  expect_slopes(1, 8, 2, 1);
}
TEST(Manufactured, QuadraticElementsHaveSlopesThreeAndTwo) {
  expect_slopes(2, 4, 3, 2);
}

// A wave across its direction changes no volume, so that one displacement solves every nu. Towards nu = 0.5
// quadratic elements fall back to the first order of the gradient, and no further; bounds are relative.
TEST(Manufactured, QuadraticElementsConvergeNearlyIncompressible) {
  for (const auto& [nu, order, bound] :
       {std::tuple(0.45, 1.9, 0.02), {0.49, 1.9, 0.025}, {0.499, 1.3, 0.06}, {0.4999, 1.0, 0.08}}) {
    const Wave wave{{1000, nu, 1, 0}, {2, 1.5, 1}, {1, -2, 1}};
    const FieldError coarse = error_on(4, 2, wave), fine = error_on(8, 2, wave);
    const double size = wave.d.norm() * wave.k.norm() / 2;  // at least, of the gradient
    EXPECT_GT(std::log2(coarse.h1 / fine.h1), order) << nu;
    EXPECT_LT(fine.h1, bound * size) << nu;
  }
}

}  // namespace
}  // namespace testbed::fem
