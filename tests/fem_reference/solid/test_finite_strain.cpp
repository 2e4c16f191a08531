// Finite strain against homogeneous closed forms, and its limit of small strain.
#include <gtest/gtest.h>

#include <set>

#include "fem_reference/solid/elasticity.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/fem_reference/respond.h"
#include "tests/fem_reference/root.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"
#include "tests/meshing/surfaces.h"

namespace testbed::fem {
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
std::vector<ConstrainedComponent> rollers(const ElasticSolid& solid) {
  std::vector<ConstrainedComponent> constrained;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3; ++c)
      if (solid.X()(c, i) == 0) constrained.push_back({i, c, 0});
  return constrained;
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
        EXPECT_NEAR(report.max_strain, strain.cwiseAbs().maxCoeff(), kNewton);
      }
}

/// A field of displacements that strains every element, by about a tenth.
Eigen::Matrix3Xd deformed(const ElasticSolid& solid) {
  Eigen::Matrix3Xd u(3, solid.X().cols());
  for (int i = 0; i < u.cols(); ++i) {
    const Vector3d x = solid.X().col(i);
    u.col(i) = 0.1 * Vector3d(std::sin(2 * x(1) + x(2)), std::cos(x(0) - 2 * x(2)), std::sin(x(0) * x(1)));
  }
  return u;
}

/// Bodies under all that has a part in the tangent.
class AssembledTangent : public testing::TestWithParam<std::tuple<ElasticLaw, int>> {
 protected:
  AssembledTangent() : solid(box_tets(2, 2, 1, 0.5, 0.1), std::get<1>(GetParam())) {
    loads.shrinkage = [](const Vector3d& x, double load_factor) {
      return 0.1 * load_factor / (1 + x.norm());
    };
    if (law != ElasticLaw::SmallStrain) loads.follower_pressure = [](int) { return 300; };
    solid.assemble(kMaterial, law, loads, {});
  }
  const ElasticLaw law = std::get<0>(GetParam());
  ElasticSolid solid;
  ElasticLoads loads;
  static constexpr double kFactor = 0.7, kStep = 1e-5, kDifference = 1e-6;
};
INSTANTIATE_TEST_SUITE_P(Laws, AssembledTangent,
                         testing::Combine(testing::Values(ElasticLaw::SmallStrain,
                                                          ElasticLaw::StVenantKirchhoff,
                                                          ElasticLaw::NeoHookean),
                                          testing::Values(1, 2)));

TEST_P(AssembledTangent, IsTheGradientOfTheForces) {
  const Eigen::Matrix3Xd u = deformed(solid);
  std::srand(1);
  const Eigen::VectorXd d = Eigen::VectorXd::Random(u.size());
  const auto force = [&](double s) -> Eigen::VectorXd {
    return solid.linearise(u + s * d.reshaped(3, u.cols()), kFactor, false).force;
  };
  const Linearisation at = solid.linearise(u, kFactor);
  const Eigen::VectorXd slope = (force(kStep) - force(-kStep)) / (2 * kStep), expected = at.tangent * d;
  EXPECT_GT(expected.norm(), 100);  // N
  EXPECT_LT((expected - slope).norm(), kDifference * expected.norm());
  EXPECT_LT((at.force - force(0)).norm(), 1e-12 * at.force.norm());
  const Eigen::SparseMatrix<double> transposed = at.tangent.transpose();
  EXPECT_LT((at.tangent - transposed).norm(), 1e-12 * at.tangent.norm());

  // Pressure and shrinkage each have a part in it.
  ElasticLoads without_pressure = loads, without_shrinkage = loads;
  without_pressure.follower_pressure = nullptr;
  without_shrinkage.shrinkage = nullptr;
  for (const ElasticLoads& some : {without_pressure, without_shrinkage}) {
    solid.assemble(kMaterial, law, some, {});
    const double part = (solid.linearise(u, kFactor).tangent * d - expected).norm() / expected.norm();
    if (law == ElasticLaw::SmallStrain)
      EXPECT_LT(part, 1e-12);
    else
      EXPECT_GT(part, 1e-2);
  }
}

TEST_P(AssembledTangent, BelongsToForcesThatAreTheGradientOfTheEnergy) {
  loads.follower_pressure = nullptr;  // whose potential is no elastic energy
  solid.assemble(kMaterial, law, loads, {});
  const Eigen::Matrix3Xd u = deformed(solid);
  std::srand(2);
  const Eigen::VectorXd d = Eigen::VectorXd::Random(u.size());
  const auto energy = [&](double s) {
    return solid.linearise(u + s * d.reshaped(3, u.cols()), kFactor, false).energy;
  };
  const double expected = solid.linearise(u, kFactor, false).force.dot(d);
  EXPECT_GT(std::abs(expected), 1);
  EXPECT_NEAR((energy(kStep) - energy(-kStep)) / (2 * kStep), expected, kDifference * std::abs(expected));
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
    std::vector<ConstrainedComponent> constrained;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3; ++c)
        if (solid.X()(0, i) == 0) constrained.push_back({i, c, 0});
    ElasticLoads loads;
    loads.body_force = [force](const Vector3d&) { return Vector3d(force, -force, 0); };
    solid.assemble(kMaterial, law, loads, constrained);
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
  EXPECT_LT(difference(1e-12), 1e-9) << "strains of 1e-12 keep their digits";
}

TEST(FiniteStrain, ElementsMayBeTurnedInsideOutBetweenThePointsOfTheirEnergy) {
  TetMesh mesh;
  mesh.X = Eigen::Matrix3Xd::Zero(3, 4);
  mesh.X.rightCols<3>().setIdentity();
  mesh.T = Eigen::Vector4i(0, 1, 2, 3);
  mesh.F.resize(3, 4);
  mesh.F << 0, 0, 0, 1, 2, 1, 3, 2, 1, 3, 2, 3;
  mesh.n_surface = 4;
  ElasticSolid solid(mesh, 2);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {});
  Eigen::Matrix3Xd u = Eigen::Matrix3Xd::Zero(3, solid.X().cols());
  u.row(0) = -0.6 * solid.X().row(0).cwiseAbs2();  // det F = 1 - 1.2 x
  const SmallestJacobians smallest = solid.smallest_jacobians(u);
  EXPECT_NEAR(smallest.at_nodes, -0.2, 1e-14);
  EXPECT_NEAR(smallest.at_points, 1 - 1.2 * (5 + 3 * std::sqrt(5)) / 20, 1e-14);
}

TEST(FiniteStrain, MovesPrescribedNodesAllTheWay) {
  const TetMesh mesh = box_tets(4, 1, 1, 0.5);
  ElasticSolid solid(mesh, 2);
  std::vector<ConstrainedComponent> constrained;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3; ++c) {
      if (solid.X()(0, i) == 0) constrained.push_back({i, c, 0});
      if (solid.X()(0, i) == 2) constrained.push_back({i, c, c == 1 ? 1.0 : 0});
    }
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, constrained);
  ElasticReport report;
  for (int n = 1; n <= 10; ++n) report = solid.solve(n / 10.0);
  ASSERT_TRUE(report.is_converged);
  for (const ConstrainedComponent& h : constrained)
    EXPECT_NEAR(solid.displacement()(h.component, h.node), h.displacement, 1e-12);
  const double strain = largest_stretch(solid.X(), solid.cells(), solid.displacement());
  EXPECT_GT(strain, 0.1);
  EXPECT_NEAR(report.max_strain, strain, 1e-12);
}

// A step that moves nothing starts from the rounding that the last has left, and has nothing to gain from it.
TEST(FiniteStrain, StaysAtRestWhereNothingMovesIt) {
  const TetMesh mesh = box_tets(4, 2, 2, 0.5, 0.1);
  for (int degree : {1, 2}) {
    ElasticSolid solid(mesh, degree);
    std::vector<ConstrainedComponent> constrained;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3; ++c)
        if (std::abs(solid.X()(0, i) - 1) > 0.8)
          constrained.push_back({i, c, c == 0 && solid.X()(0, i) > 1 ? 0.3 : 0});
    ElasticLoads loads;
    loads.motion = [&](int k, double t) {
      return std::min(1., 2 * t) * constrained[k].displacement;
    };  // and then rests
    solid.assemble({1e5, 0.45, 1, 0}, ElasticLaw::NeoHookean, loads, constrained);
    Eigen::Matrix3Xd at_pause;
    for (double t : {0., 0.25, 0.5, 0.75, 1.}) {
      const ElasticReport report = solid.solve(t);
      ASSERT_TRUE(report.is_converged) << t;
      if (t == 0) {
        EXPECT_EQ(solid.displacement().norm(), 0);
      }
      if (t == 0.5) at_pause = solid.displacement();
    }
    EXPECT_GT(at_pause.norm(), 0.3);
    EXPECT_LT((solid.displacement() - at_pause).norm(), 1e-9 * at_pause.norm());
  }
}

/// Radial displacement at radii 1 and 2 of a thick sphere under a pressure p from within that follows it: its
/// equilibrium d(R^2 P_r)/dR = 2 R P_t by the method of shooting.
Eigen::Vector2d widened_sphere(double p) {
  const LameConstants lame(kMaterial);
  const auto stress = [&](double radial, double tangential) -> Vector3d {
    return respond(ElasticLaw::NeoHookean, lame, Vector3d(radial, tangential, tangential).asDiagonal(), 0)
        .P.diagonal();
  };
  const auto radial_stretch = [&](double P, double tangential) {
    return root([&](double s) { return stress(s, tangential)(0) - P; }, 0.2, 2);
  };
  constexpr int kSteps = 20;
  const auto shoot = [&](double inner) {  // deformed radii and, last, the stress that should be zero
    Eigen::Vector2d state(inner, -p * inner * inner);  // r and R^2 P_r
    const auto slope = [&](double R, const Eigen::Vector2d& y) -> Eigen::Vector2d {
      const double radial = radial_stretch(y(1) / (R * R), y(0) / R);
      return {radial, 2 * R * stress(radial, y(0) / R)(1)};
    };
    const double h = 1.0 / kSteps;
    for (int n = 0; n < kSteps; ++n) {
      const double R = 1 + n * h;
      const Eigen::Vector2d a = slope(R, state), b = slope(R + h / 2, state + h / 2 * a),
                            c = slope(R + h / 2, state + h / 2 * b), d = slope(R + h, state + h * c);
      state += h / 6 * (a + 2 * b + 2 * c + d);
    }
    return state;
  };
  const double inner = root([&](double r) { return shoot(r)(1); }, 1, 1.6);
  return {inner - 1, shoot(inner)(0) - 2};
}

// The inscribed polyhedra's error falls as their edges squared and is extrapolated away.
TEST(FiniteStrain, WidensAThickSphereAsItsEquationSays) {
  constexpr double p = 150;
  const Eigen::Array2d exact = widened_sphere(p);
  EXPECT_GT(exact(0), 0.1);  // far from small
  std::vector<Eigen::Array2d> u;
  for (int n : {42, 162}) {
    const SurfaceMesh outer = make_shape("ball", n, {4, 4, 4}), inner = make_shape("ball", n, {2, 2, 2});
    TetOptions options;
    options.interior_size = 3.8 / std::sqrt(n);
    const TetMesh mesh = tetrahedralize(join(outer, inside_out(inner)), options);
    ElasticLoads loads;
    loads.follower_pressure = [first = outer.F.cols()](int f) { return f < first ? 0 : p; };
    ElasticSolid solid(mesh, 2);
    solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
    const ElasticReport report = solid.solve();
    ASSERT_TRUE(report.is_converged);
    const int n_outer = static_cast<int>(outer.X.cols()), n_inner = static_cast<int>(inner.X.cols());
    const Eigen::RowVectorXd radial =
        solid.displacement()
            .leftCols(n_outer + n_inner)
            .cwiseProduct(mesh.X.leftCols(n_outer + n_inner).colwise().normalized())
            .colwise()
            .sum();
    u.push_back({radial.tail(n_inner).mean(), radial.head(n_outer).mean()});
  }
  const Eigen::Array2d extrapolated = (4 * u[1] - u[0]) / 3;
  for (int k = 0; k < 2; ++k) EXPECT_NEAR(extrapolated(k) / exact(k), 1, 2e-3);
}

// Under inflation the tangent of an unstressed bar is not definite. Load parts alone took 200 iterations.
TEST(FiniteStrain, InflatesASlenderBarInFewIterations) {
  const TetMesh mesh = box_tets(8, 2, 2, 0.5);
  for (int degree : {1, 2}) {
    ElasticSolid solid(mesh, degree);
    std::vector<ConstrainedComponent> constrained;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3 && solid.X()(0, i) == 0; ++c) constrained.push_back({i, c, 0});
    ElasticLoads loads;
    loads.follower_pressure = [](int) { return -250; };
    solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, constrained);
    const ElasticReport report = solid.solve();
    EXPECT_TRUE(report.is_converged);
    const double strain = largest_stretch(solid.X(), solid.cells(), solid.displacement());
    EXPECT_GT(strain, 0.1);
    EXPECT_NEAR(report.max_strain, strain, 1e-12);
    EXPECT_LE(report.newton_iterations, 12);
  }
}

}  // namespace
}  // namespace testbed::fem
