// A body of two parts that meet, on either degree.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "meshing/surface/surface_check.h"
#include "meshing/surface_energies/self_barrier.h"
#include "meshing/surface_energies/surface_points.h"
#include "tests/fem_reference/dynamics_of.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using namespace meshing;

const Material kMaterial{1e4, 0.3, 1000, 0};
constexpr double kGap = 0.1, kThickness = 0.03;

/// Two cubes of 1 m, one above the other and a little turned, as one body.
TetMesh two_cubes() {
  const TetMesh cube = box_tets(2, 2, 2, 0.5);
  const int n = static_cast<int>(cube.X.cols());
  TetMesh both;
  both.X.resize(3, 2 * n);
  const Eigen::AngleAxisd turn(0.3, Vector3d::UnitZ());
  both.X << cube.X, (turn.toRotationMatrix() * cube.X).colwise() + Vector3d(0.1, -0.05, 1 + kGap);
  both.T.resize(4, 2 * cube.T.cols());
  both.T << cube.T, cube.T.array() + n;
  both.F.resize(3, 2 * cube.F.cols());
  both.F << cube.F, cube.F.array() + n;
  both.n_surface = 2 * n;
  return both;
}

class TwoCubes : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Degrees, TwoCubes, testing::Values(1, 2));

// By implicit Euler, whose steps gain no energy.
TEST_P(TwoCubes, ThatMeetBounceKeepTheirMomentumAndGainNoEnergy) {
  ElasticSolid solid(two_cubes(), GetParam());
  const Matrix3Xd X = solid.X();
  ElasticLoads loads;
  const Eigen::Matrix3Xi triangles = flat_triangles(solid.faces());
  const auto barrier = std::make_shared<SelfBarrier>(X, triangles, kMaterial.E, kThickness);
  loads.surface = {barrier};
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
  const Dynamics s = dynamics_of(solid);
  GeneralisedAlpha motion(s, 0.01, kImplicitEuler);
  Matrix3Xd v = Matrix3Xd::Zero(3, X.cols());
  for (int i = 0; i < X.cols(); ++i) v(2, i) = X(2, i) > 1 + kGap / 2 ? -0.5 : 0.5;
  motion.restart(VectorXd::Zero(v.size()), v.reshaped());
  const double first = motion.kinetic_energy(), sum = momentum_of(s, motion.v(), 2);
  double energy = first;
  bool met = false;
  for (int n = 0; n < 60; ++n) {
    ASSERT_TRUE(motion.step()) << n;
    const Matrix3Xd x = X + motion.u().reshaped(3, X.cols());
    met |= barrier->energy(x) > 0;
    EXPECT_TRUE(self_intersections({x, triangles, {}}).empty()) << n;
    const double now = motion.kinetic_energy() + solid.energy(motion.u().reshaped(3, X.cols()));
    EXPECT_LT(now, energy + 1e-6 * first) << n;
    energy = now;
  }
  EXPECT_TRUE(met);
  double relative = 0;
  for (int i = 0; i < X.cols(); ++i)
    relative += (X(2, i) > 1 + kGap / 2 ? 1 : -1) * motion.v()(3 * i + 2) / static_cast<double>(X.cols());
  EXPECT_GT(relative, 0.05) << "and apart again";
  EXPECT_NEAR(momentum_of(s, motion.v(), 2), sum, 1e-6 * 1000);
}

}  // namespace
}  // namespace testbed::fem
