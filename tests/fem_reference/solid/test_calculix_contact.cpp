// Static contact against CalculiX on the same tetrahedra, of the same law. CalculiX lets surfaces overlap by a linear
// penalty and the barrier keeps them apart, both by at most a thousandth of what the body is pressed by. Friction
// begins with a slip as small in both. Both sum over faces, at other points: this decides where few faces touch a sphere.
#include <gtest/gtest.h>

#include <cmath>

#include "fem_reference/solid/elasticity.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/barrier.h"
#include "tests/fem_reference/calculix.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using namespace meshing;

const Material kMaterial{1e6, 0.3, 1000, 0};
constexpr double kRange = 1e-5;  // of the barrier (m)

/// A cube of 1 m that is clamped at its bottom, and a tool above it.
class PressedFromAbove : public testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    if (!has_calculix()) GTEST_SKIP() << "ccx is not installed (Debian package calculix-ccx)";
    job.material = kMaterial;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3 && solid.X()(2, i) == 0; ++c) job.constrained.push_back({i, c, 0});
    const Matrix3Xd areas = area_vectors(mesh.X, mesh.F);
    for (int f = 0; f < areas.cols(); ++f)
      if (areas(2, f) > 0.5 * areas.col(f).norm()) top.push_back(f);
  }

  Matrix3Xd pressed_by(Obstacle obstacle, const Vector3d& displacement) {
    obstacle.motion = {{0, 0, 0, 0}, {1, displacement(0), displacement(1), displacement(2)}};
    obstacle.range = kRange;
    std::vector<char> is_constrained(solid.X().cols(), false);
    for (const ConstrainedComponent& h : job.constrained) is_constrained[h.node] = true;
    ElasticLoads loads;
    loads.surface =
        obstacles_in_statics({RigidBody(obstacle)}, solid.X(), solid.faces(), kMaterial.E, is_constrained);
    solid.assemble(kMaterial, ElasticLaw::SmallStrain, loads, job.constrained);
    for (const double load_factor : {0.25, 0.5, 0.75, 1.}) EXPECT_TRUE(solid.solve(load_factor).is_converged);
    return solid.displacement();
  }
  /// On the tool (N).
  Vector3d force(const Matrix3Xd& u) const {
    const Eigen::VectorXd f = solid.stiffness() * u.reshaped();
    Vector3d sum = Vector3d::Zero();
    for (const ConstrainedComponent& h : job.constrained) sum(h.component) -= f(3 * h.node + h.component);
    return sum;
  }
  /// Returns the force on the tool (N).
  Vector3d expect_alike(const Obstacle& obstacle, double displacement_tolerance, double force_tolerance) {
    const Matrix3Xd u = pressed_by(obstacle, job.tool->displacement), v = run_calculix(solid, job).u;
    EXPECT_LT((u - v).norm(), displacement_tolerance * u.norm());
    EXPECT_LT((force(u) - force(v)).norm(), force_tolerance * force(u).norm());
    return force(u);
  }

  const int n = 8 / GetParam();  ///< cubes along an edge
  const TetMesh mesh = box_tets(n, n, n, 1. / n);
  ElasticSolid solid{mesh, GetParam()};
  CalculixJob job;
  std::vector<int> top;  ///< triangles
};
INSTANTIATE_TEST_SUITE_P(Degree, PressedFromAbove, testing::Values(1, 2));

TEST_P(PressedFromAbove, ByASphereAlike) {
  constexpr double kRadius = 2;
  Obstacle sphere;
  sphere.shape = Ball{{0.5, 0.5, 1 + kRadius}, kRadius};
  const auto height = [](double x, double y) {
    return 1 + kRadius - std::sqrt(kRadius * kRadius - (x - 0.5) * (x - 0.5) - (y - 0.5) * (y - 0.5));
  };
  job.tool = {height, 0, 1, 40, {0, 0, -0.02}, 0, top};
  expect_alike(sphere, 0.04, 0.02);
}

// Pushed aside by a quarter of what it presses down it sticks, by three times that it slips with half of the force.
TEST_P(PressedFromAbove, ByAPlateWithFrictionThatSticksAndSlipsAlike) {
  Obstacle plate;
  plate.shape = HalfSpace{{0, 0, 1}, {0, 0, -1}};
  plate.friction = 0.5;
  const auto share = [&](double aside) {
    job.tool = {[](double, double) { return 1; }, -0.25, 1.25, 1, {aside, 0, -0.02}, plate.friction, top};
    const Vector3d f = expect_alike(plate, 4e-3, 4e-3);
    return f(0) / -f(2);
  };
  EXPECT_LT(share(0.005), 0.1);
  EXPECT_NEAR(share(0.06), plate.friction, 0.01);
}

}  // namespace
}  // namespace testbed::fem
