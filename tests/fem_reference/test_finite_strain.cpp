// Finite strain against homogeneous closed forms, and its limit of small strain.
#include <gtest/gtest.h>

#include <set>

#include "fem_reference/elasticity.h"
#include "fem_reference/laws.h"
#include "meshing/surface.h"
#include "tests/fem_reference/tets.h"
#include "tests/massspring/box_tets.h"

namespace testbed {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const Material kMaterial{1000, 0.3, 1, 0};

/// Traction t along x on the ends x = 0 and x = length, per area at rest.
ElasticLoads pull(const TetMesh& mesh, double t) {
  const Eigen::Matrix3Xd normals = area_vectors(mesh.X, mesh.F).colwise().normalized();
  ElasticLoads loads;
  loads.traction = [normals, t](const Vector3d&, int f) -> Vector3d {
    return {std::abs(normals(0, f)) > 0.5 ? t * normals(0, f) : 0, 0, 0};
  };
  return loads;
}

/// Rollers on x = 0, y = 0 and z = 0.
std::vector<HeldComponent> rollers(const ElasticSolid& solid) {
  std::vector<HeldComponent> held;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3; ++c)
      if (solid.X()(c, i) == 0) held.push_back({i, c, 0});
  return held;
}

/// Traction that stretches a bar by `stretch` with free sides: the side stretch is found by bisection.
double uniaxial_traction(ElasticLaw law, double stretch, double& side) {
  const LameConstants lame(kMaterial);
  double low = 0.3, high = 2;
  const auto P = [&](double s) { return respond(law, lame, Vector3d(stretch, s, s).asDiagonal(), 0).P; };
  for (int k = 0; k < 60; ++k) {
    side = (low + high) / 2;
    (P(side)(1, 1) < 0 ? low : high) = side;
  }
  return P(side)(0, 0);
}

TEST(FiniteStrain, StretchesABarAsTheClosedForm) {
  constexpr double kNewton = 1e-7;  // stops at 1e-9 of the first residual
  for (ElasticLaw law : {ElasticLaw::StVenantKirchhoff, ElasticLaw::NeoHookean})
    for (double stretch : {0.75, 1.5})
      for (int degree : {1, 2}) {
        double side = 1;
        const double t = uniaxial_traction(law, stretch, side);
        const TetMesh mesh = box_tets(3, 2, 2, 0.5);
        ElasticSolid solid(mesh, degree);
        solid.assemble(kMaterial, law, pull(mesh, t), rollers(solid));
        ElasticReport report;
        for (int n = 1; n <= 5; ++n) report = solid.solve(n / 5.0);
        ASSERT_TRUE(report.is_converged) << static_cast<int>(law) << ' ' << stretch;
        const Vector3d strain(stretch - 1, side - 1, side - 1);
        EXPECT_LT(largest_error(solid.X(), solid.displacement(),
                                [&](const Vector3d& x) -> Vector3d { return strain.cwiseProduct(x); }),
                  kNewton);
      }
}

TEST(FiniteStrain, ConvergesQuadraticallyFromTheStepBefore) {
  double side;
  const double t = uniaxial_traction(ElasticLaw::NeoHookean, 1.3, side);
  const TetMesh mesh = box_tets(2, 2, 2, 0.5);
  ElasticSolid solid(mesh, 2);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, pull(mesh, t), rollers(solid));
  const ElasticReport report = solid.solve(1);
  EXPECT_TRUE(report.is_converged);
  EXPECT_LE(report.newton_iterations, 6);  // a wrong tangent needs dozens
}

TEST(FiniteStrain, ShrinksFreelyWithoutStress) {
  const TetMesh mesh = box_tets(2, 2, 2, 0.5, 0.1);
  ElasticSolid solid(mesh, 2);
  ElasticLoads loads;
  loads.shrinkage = [](const Vector3d&, double load_factor) { return 0.4 * load_factor; };
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
  ElasticReport report;
  for (int n = 1; n <= 4; ++n) report = solid.solve(n / 4.0);
  ASSERT_TRUE(report.is_converged);
  const Eigen::Matrix3Xd expected = without_rigid_motion(solid.X(), -0.4 * solid.X());
  EXPECT_LT((without_rigid_motion(solid.X(), solid.displacement()) - expected).norm(),
            1e-7 * expected.norm());
}

// The tangent of a deformed body takes the rotations of its present shape to zero, not those of its first.
TEST(FiniteStrain, CollapsesFreeBodiesAroundAPoint) {
  constexpr double kNewton = 1e-7;
  const TetMesh mesh = box_tets(4, 3, 2, 0.5, 0.15);
  ElasticLoads loads;
  loads.shrinkage = [](const Vector3d& x, double load_factor) {
    return 0.15 * load_factor / (1 + (x - Vector3d(0.3, 1.4, 0.8)).norm());
  };
  for (int degree : {1, 2}) {
    std::vector<double> lengths[2];
    for (int n_steps : {1, 3}) {
      ElasticSolid solid(mesh, degree);
      solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
      for (int step = 1; step <= n_steps; ++step) {
        const ElasticReport report = solid.solve(double(step) / n_steps);
        ASSERT_TRUE(report.is_converged);
        EXPECT_LE(report.newton_iterations, 6);
      }
      const Eigen::Matrix3Xd x = solid.X() + solid.displacement();
      for (int i = 1; i < x.cols(); ++i) lengths[n_steps > 1].push_back((x.col(i) - x.col(0)).norm());
    }
    for (size_t i = 0; i < lengths[0].size(); ++i) EXPECT_NEAR(lengths[0][i], lengths[1][i], kNewton);
    EXPECT_LT(lengths[0].back(), 0.97 * (mesh.X.col(mesh.X.cols() - 1) - mesh.X.col(0)).norm());
  }
}

TEST(FiniteStrain, TendsToSmallStrainWithTheLoad) {
  const TetMesh mesh = box_tets(4, 1, 1, 0.5);
  const auto sag = [&](ElasticLaw law, double force) {
    ElasticSolid solid(mesh, 2);
    std::vector<HeldComponent> held;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3; ++c)
        if (solid.X()(0, i) == 0) held.push_back({i, c, 0});
    ElasticLoads loads;
    loads.body_force = [force](const Vector3d&) { return Vector3d(force, -force, 0); };
    solid.assemble(kMaterial, law, loads, held);
    EXPECT_TRUE(solid.solve().is_converged);
    return Eigen::Matrix3Xd(solid.displacement() / force);
  };
  const Eigen::Matrix3Xd small = sag(ElasticLaw::SmallStrain, 1);
  const auto difference = [&](double force) {
    return (sag(ElasticLaw::NeoHookean, force) - small).norm() / small.norm();
  };
  const double large = difference(0.2), little = difference(0.1);
  EXPECT_LT(little, 0.02);
  EXPECT_NEAR(std::log2(large / little), 1, 0.2);  // the first non-linear term is quadratic in the load
}

TEST(FiniteStrain, MovesPrescribedNodesAllTheWay) {
  const TetMesh mesh = box_tets(4, 1, 1, 0.5);
  ElasticSolid solid(mesh, 2);
  std::vector<HeldComponent> held;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3; ++c) {
      if (solid.X()(0, i) == 0) held.push_back({i, c, 0});
      if (solid.X()(0, i) == 2) held.push_back({i, c, c == 1 ? 1.0 : 0});
    }
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, held);
  ElasticReport report;
  for (int n = 1; n <= 10; ++n) report = solid.solve(n / 10.0);
  ASSERT_TRUE(report.is_converged);
  for (const HeldComponent& h : held)
    EXPECT_NEAR(solid.displacement()(h.component, h.node), h.displacement, 1e-12);
  EXPECT_GT(report.max_strain, 0.1);
}

}  // namespace
}  // namespace testbed
