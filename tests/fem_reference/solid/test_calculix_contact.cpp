// Static contact against CalculiX on the same tetrahedra, of the same law. CalculiX lets surfaces overlap by a linear
// penalty and the barrier keeps them apart, both by at most a thousandth of what the body is pressed by. Friction
// begins with a slip as small in both. Both sum over faces, at other points: this decides where few faces touch a sphere.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

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

/// A box whose lowest corner is the origin, and a tool above it.
class BelowATool : public testing::TestWithParam<int> {
 protected:
  explicit BelowATool(TetMesh of) : mesh(std::move(of)) {
    job.material = kMaterial;
    const Matrix3Xd areas = area_vectors(mesh.X, mesh.F);
    for (int f = 0; f < areas.cols(); ++f)
      if (areas(2, f) > 0.5 * areas.col(f).norm()) top.push_back(f);
  }
  void SetUp() override {
    if (!has_calculix()) GTEST_SKIP() << "ccx is not installed (Debian package calculix-ccx)";
  }

  /// A component of the nodes whose coordinate `axis` is 0.
  void hold(int axis, int component, double displacement = 0) {
    for (int i = 0; i < solid.X().cols(); ++i)
      if (solid.X()(axis, i) == 0) job.constrained.push_back({i, component, displacement});
  }
  /// Equilibrium at full load; none, if load steps do not lead there.
  std::optional<Matrix3Xd> pressed_by(Obstacle obstacle) {
    const Vector3d moved = job.tool->displacement;
    obstacle.motion = {{0, 0, 0, 0}, {1, moved(0), moved(1), moved(2)}};
    obstacle.friction = job.tool->friction;
    obstacle.range = kRange;
    std::vector<int> n_components(solid.X().cols());
    for (const ConstrainedComponent& h : job.constrained) ++n_components[h.node];
    std::vector<char> is_constrained(n_components.size());
    for (size_t i = 0; i < n_components.size(); ++i) is_constrained[i] = n_components[i] == 3;
    ElasticLoads loads;
    loads.body_force = [this](const Vector3d&) -> Vector3d { return kMaterial.rho * job.gravity; };
    loads.surface =
        obstacles_in_statics({RigidBody(obstacle)}, solid.X(), solid.faces(), kMaterial.E, is_constrained);
    solid.assemble(kMaterial, ElasticLaw::SmallStrain, loads, job.constrained);
    for (const double load_factor : {0.25, 0.5, 0.75, 1.})
      if (!solid.solve(load_factor).is_converged) return {};
    return solid.displacement();
  }
  /// Out of balance at the nodes (N), 3 x n: what supports and the tool exert.
  Matrix3Xd reactions(const Matrix3Xd& u) const {
    return (solid.stiffness() * u.reshaped() - solid.load()).reshaped(3, u.cols());
  }
  /// Of the tool on the body (N), without what supports hold.
  Vector3d tool_force(const Matrix3Xd& u) const {
    Matrix3Xd f = reactions(u);
    for (const ConstrainedComponent& h : job.constrained) f(h.component, h.node) = 0;
    std::vector<char> is_touched(u.cols(), false);
    for (const int t : top)
      for (const int node : solid.faces().col(t)) is_touched[node] = true;
    Vector3d sum = Vector3d::Zero();
    for (int i = 0; i < u.cols(); ++i)
      if (is_touched[i]) sum += f.col(i);
    return sum;
  }
  /// Returns the tool's force (N).
  Vector3d expect_alike(const Obstacle& obstacle, double displacement_tolerance, double force_tolerance) {
    const std::optional<Matrix3Xd> u = pressed_by(obstacle);
    if (!u) throw std::runtime_error("no equilibrium found");
    const Matrix3Xd v = run_calculix(solid, job).u;
    const Vector3d ours = tool_force(*u), theirs = tool_force(v);
    EXPECT_LT((*u - v).norm(), displacement_tolerance * u->norm());
    EXPECT_LT((ours - theirs).norm(), force_tolerance * ours.norm());
    return ours;
  }

  const TetMesh mesh;
  ElasticSolid solid{mesh, GetParam()};
  CalculixJob job;
  std::vector<int> top;  ///< triangles
};

Obstacle sphere_on(const Vector3d& point, double radius) {
  Obstacle sphere;
  sphere.shape = Ball{point + radius * Vector3d::UnitZ(), radius};
  return sphere;
}

/// The lower side of a sphere on a point (m).
std::function<double(double x, double y)> height_of_sphere(const Vector3d& point, double radius) {
  return [=](double x, double y) {
    const double to_axis = std::hypot(x - point(0), y - point(1));
    return point(2) + radius - std::sqrt(radius * radius - to_axis * to_axis);
  };
}

Obstacle plate_above(double z) {
  Obstacle plate;
  plate.shape = HalfSpace{{0, 0, z}, {0, 0, -1}};
  return plate;
}

/// A cube of 1 m that is clamped at its bottom.
class PressedFromAbove : public BelowATool {
 protected:
  PressedFromAbove() : BelowATool(box_tets(8 / GetParam(), 8 / GetParam(), 8 / GetParam(), GetParam() / 8.)) {
    for (int c = 0; c < 3; ++c) hold(2, c);
  }
};
INSTANTIATE_TEST_SUITE_P(Degree, PressedFromAbove, testing::Values(1, 2));

TEST_P(PressedFromAbove, ByASphereAlike) {
  constexpr double kRadius = 2;
  const Vector3d pole(0.5, 0.5, 1);
  job.tool = {height_of_sphere(pole, kRadius), 0, 1, 40, {0, 0, -0.02}, 0, top};
  expect_alike(sphere_on(pole, kRadius), 0.04, 0.02);
}

// Pushed aside by a quarter of what it presses down it sticks, by three times that it slips with half of the force.
TEST_P(PressedFromAbove, ByAPlateWithFrictionThatSticksAndSlipsAlike) {
  constexpr double kFriction = 0.5;
  const auto share = [&](double aside) {
    job.tool = {[](double, double) { return 1; }, -0.25, 1.25, 1, {aside, 0, -0.02}, kFriction, top};
    const Vector3d f = expect_alike(plate_above(1), 4e-3, 4e-3);
    return std::abs(f(0) / f(2));
  };
  EXPECT_LT(share(0.005), 0.1);
  EXPECT_NEAR(share(0.06), kFriction, 0.01);
}

constexpr double kDepthOfBlock = 10, kContactRadius = 0.5;  // m

/// A quarter of a block, cubes of which are graded towards an upper corner, where a quarter of a sphere presses.
TetMesh graded_block(int n) {
  constexpr double kGrading = 5;
  TetMesh mesh = box_tets(n, n, n, 1. / n);
  const auto graded = [](double s) { return kDepthOfBlock * std::sinh(kGrading * s) / std::sinh(kGrading); };
  for (auto X : mesh.X.colwise()) X = Vector3d(graded(X(0)), graded(X(1)), kDepthOfBlock - graded(1 - X(2)));
  return mesh;
}

class QuarterOfAHalfSpace : public BelowATool {
 protected:
  QuarterOfAHalfSpace() : BelowATool(graded_block(12 / GetParam())) {
    for (int c = 0; c < 3; ++c) hold(c, c);
    const auto is_far = [&](int f) {
      return mesh.X({0, 1}, mesh.F.col(f)).rowwise().minCoeff().maxCoeff() > 1.5 * kContactRadius;
    };
    top.erase(std::remove_if(top.begin(), top.end(), is_far), top.end());
  }
};
INSTANTIATE_TEST_SUITE_P(Degree, QuarterOfAHalfSpace, testing::Values(1, 2));

// 4/3 E / (1 - nu^2) sqrt(R d^3) [Hertz 1881].
TEST_P(QuarterOfAHalfSpace, MeetsASphereAlikeAndWithHertzForce) {
  constexpr double kRadius = 5, kDepth = kContactRadius * kContactRadius / kRadius;
  const Vector3d pole(0, 0, kDepthOfBlock);
  job.tool = {height_of_sphere(pole, kRadius), 0, 1.5 * kContactRadius, 24, {0, 0, -kDepth}, 0, top};
  job.increment = 0.5;
  const bool is_linear = GetParam() == 1;
  const Vector3d f =
      expect_alike(sphere_on(pole, kRadius), is_linear ? 0.005 : 0.035, is_linear ? 0.006 : 0.05);
  const double hertz =
      4. / 3 * kMaterial.E / (1 - kMaterial.nu * kMaterial.nu) * std::sqrt(kRadius * std::pow(kDepth, 3));
  EXPECT_NEAR(-4 * f(2) / hertz, 1, is_linear ? 0.2 : 0.07);
}

/// A block of 1 x 1 x 0.5 m and a plate with friction above it, with gravity as a slope has it.
class OnASlope : public BelowATool {
 protected:
  static constexpr double kFriction = 0.5, kHeight = 0.5, kLength = 1;
  OnASlope() : BelowATool(box_tets(4 / GetParam(), 4 / GetParam(), 2 / GetParam(), GetParam() / 4.)) {
    constexpr double kOverlap = 1e-7;  // m: so that the body is held as its load begins
    job.tool = {[](double, double) { return kHeight - kOverlap; }, -0.25, 1.25, 1, {0, 0, 0}, kFriction, top};
  }
  void tilt(double tangent) {
    const double angle = std::atan(tangent);
    job.gravity = 50 * Vector3d(std::sin(angle), 0, std::cos(angle));
  }
  /// Of the tool's force along the slope in that across it.
  double share() {
    const Vector3d f = expect_alike(plate_above(kHeight), GetParam() == 1 ? 3e-3 : 0.03, 1e-6);
    EXPECT_NEAR(-f(2) / (kMaterial.rho * kHeight * job.gravity(2)), 1, 1e-6);
    return f(0) / f(2);
  }
};
INSTANTIATE_TEST_SUITE_P(Degree, OnASlope, testing::Values(1, 2));

TEST_P(OnASlope, SticksBelowTheAngleOfFrictionAlike) {
  constexpr double kTangent = 0.96 * kFriction;
  tilt(kTangent);
  EXPECT_NEAR(share(), kTangent, 1e-6);
}

TEST_P(OnASlope, HasNoEquilibriumBeyondTheAngleOfFriction) {
  tilt(1.04 * kFriction);
  EXPECT_FALSE(pressed_by(plate_above(kHeight)));
  try {
    run_calculix(solid, job);
    FAIL() << "CalculiX: an equilibrium";
  } catch (const std::runtime_error& error) {
    const std::string said = error.what(), slid = "largest increment of disp=";
    EXPECT_NE(said.find("*ERROR: too many cutbacks"), std::string::npos);
    EXPECT_GT(std::stod(said.substr(said.rfind(slid) + slid.size())), kLength);
  }
}

class OnASlopeWithAStop : public OnASlope {};
INSTANTIATE_TEST_SUITE_P(Degree, OnASlopeWithAStop, testing::Values(1));

// In plane strain, so that all of it slips downhill.
TEST_P(OnASlopeWithAStop, SlipsBeyondTheAngleOfFrictionAlike) {
  tilt(1.2 * kFriction);
  for (int i = 0; i < solid.X().cols(); ++i) job.constrained.push_back({i, 1, 0});
  hold(2, 0, 0.01);
  EXPECT_NEAR(share(), kFriction, 1e-6);
}

}  // namespace
}  // namespace testbed::fem
