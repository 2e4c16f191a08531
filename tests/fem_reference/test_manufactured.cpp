// Slopes of the error on a smooth manufactured solution: the reference converges at the rate of its degree.
#include <gtest/gtest.h>

#include <set>

#include "fem_reference/elasticity.h"
#include "fem_reference/laws.h"
#include "tests/fem_reference/tets.h"
#include "tests/massspring/box_tets.h"

namespace testbed {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const Material kMaterial{1000, 0.3, 1, 0};
const Vector3d kWave(2, 1.5, 1), kDirection(1, -0.5, 0.7);

// u = d sin(k . x): grad u = d k^T cos, -div sigma = [(lambda + mu) (d . k) k + mu |k|^2 d] sin.
Vector3d displacement(const Vector3d& x) {
  return kDirection * std::sin(kWave.dot(x));
}
Matrix3d gradient(const Vector3d& x) {
  return kDirection * kWave.transpose() * std::cos(kWave.dot(x));
}
Vector3d body_force(const Vector3d& x) {
  const LameConstants lame(kMaterial);
  return ((lame.lambda + lame.mu) * kDirection.dot(kWave) * kWave +
          lame.mu * kWave.squaredNorm() * kDirection) *
         std::sin(kWave.dot(x));
}

FieldError error_on(int n, int degree) {
  ElasticSolid solid(box_tets(n, n, n, 1.0 / n), degree);
  std::vector<HeldComponent> held;
  std::set<int> boundary(solid.faces().data(), solid.faces().data() + solid.faces().size());
  for (int i : boundary)
    for (int c = 0; c < 3; ++c) held.push_back({i, c, displacement(solid.X().col(i))(c)});
  ElasticLoads loads;
  loads.body_force = body_force;
  solid.assemble(kMaterial, ElasticLaw::SmallStrain, loads, held);
  EXPECT_TRUE(solid.solve().is_converged);
  return field_error(solid.X(), solid.cells(), solid.displacement(), displacement, gradient);
}

void expect_slopes(int degree, int n, double l2, double h1) {
  constexpr double kWithin = 0.1;  // of the asymptotic slope on these meshes
  const FieldError coarse = error_on(n, degree), fine = error_on(2 * n, degree);
  EXPECT_NEAR(std::log2(coarse.l2 / fine.l2), l2, kWithin);
  EXPECT_NEAR(std::log2(coarse.h1 / fine.h1), h1, kWithin);
}

TEST(Manufactured, LinearElementsHaveSlopesTwoAndOne) {
  expect_slopes(1, 8, 2, 1);
}
TEST(Manufactured, QuadraticElementsHaveSlopesThreeAndTwo) {
  expect_slopes(2, 4, 3, 2);
}

}  // namespace
}  // namespace testbed
