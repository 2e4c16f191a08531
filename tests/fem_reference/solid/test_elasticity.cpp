// The reference against exact solutions: polynomials on real meshes, spheres, beams.
#include <gtest/gtest.h>

#include <filesystem>
#include <set>
#include <sstream>

#include "fem_reference/elements/laws.h"
#include "fem_reference/solid/elasticity.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"
#include "tests/meshing/flat_tetrahedra.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Field = std::function<Vector3d(const Vector3d&)>;
using StressField = std::function<Matrix3d(const Vector3d&)>;

const Material kMaterial{1000, 0.3, 1, 0};
constexpr double kSolverTolerance = 1e-8;  // conjugate gradients stop at a relative residual of 1e-11

ElasticLoads tractions(const StressField& stress, const TetMesh& mesh) {
  ElasticLoads loads;
  const Matrix3Xd normals = area_vectors(mesh.X, mesh.F).colwise().normalized();
  loads.traction = [stress, normals](const Vector3d& x, int f) -> Vector3d {
    return stress(x) * normals.col(f);
  };
  return loads;
}

ElasticReport solve(ElasticSolid& solid, const ElasticLoads& loads,
                    const std::vector<ConstrainedComponent>& constrained = {},
                    ElasticLaw law = ElasticLaw::SmallStrain) {
  solid.assemble(kMaterial, law, loads, constrained);
  const ElasticReport report = solid.solve();
  EXPECT_TRUE(report.is_converged);
  return report;
}

std::vector<ConstrainedComponent> hold(const ElasticSolid& solid, const std::set<int>& nodes,
                                       const Field& u) {
  std::vector<ConstrainedComponent> constrained;
  for (int i : nodes)
    for (int c = 0; c < 3; ++c) constrained.push_back({i, c, u(solid.X().col(i))(c)});
  return constrained;
}

std::set<int> boundary_nodes(const ElasticSolid& solid) {
  return {solid.faces().data(), solid.faces().data() + solid.faces().size()};
}

double error_to_rigid_motion(const ElasticSolid& solid, const Field& exact) {
  Matrix3Xd expected(3, solid.X().cols());
  for (int i = 0; i < expected.cols(); ++i) expected.col(i) = exact(solid.X().col(i));
  const Matrix3Xd a = without_rigid_motion(solid.X(), solid.displacement()),
                  b = without_rigid_motion(solid.X(), expected);
  return (a - b).norm() / b.norm();
}

class RealMesh : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    const std::filesystem::path file = std::filesystem::path(MESH_FOLDER) / GetParam();
    if (!std::filesystem::exists(file)) GTEST_SKIP() << file << " is not here";
    mesh = tetrahedralize(read_surface(file));
  }
  TetMesh mesh;
};
INSTANTIATE_TEST_SUITE_P(Shared, RealMesh,
                         testing::Values("sphere_small.ply", "torus.obj", "handle.off", "liver2.obj",
                                         "spot.ply"),
                         [](const auto& info) {
                           const std::string name = info.param;
                           return name.substr(0, name.find('.'));
                         });

TEST_P(RealMesh, PassesThePatchTest) {
  constexpr double kExact = 1e-10;
  const Matrix3d G = (Matrix3d() << 1, 2, -1, .5, -2, 3, 1, 1, 2).finished() * 1e-3;
  const Field linear = [&](const Vector3d& x) -> Vector3d { return G * x + Vector3d(1, 2, 3) * 1e-3; };
  for (int degree : {1, 2}) {
    ElasticSolid solid(mesh, degree);
    solve(solid, {}, hold(solid, boundary_nodes(solid), linear));
    EXPECT_LT(largest_error(solid.X(), solid.displacement(), linear), kExact) << "degree " << degree;
  }
}

TEST_P(RealMesh, ShrinksUniformlyUnderPressure) {
  constexpr double p = 2, kExact = 1e-9;
  for (int degree : {1, 2}) {
    ElasticSolid solid(mesh, degree);
    solve(solid, tractions([](const Vector3d&) -> Matrix3d { return -p * Matrix3d::Identity(); }, mesh));
    EXPECT_EQ(solid.n_free_rigid_motions(), 6);
    const double factor = -(1 - 2 * kMaterial.nu) * p / kMaterial.E;
    EXPECT_LT(error_to_rigid_motion(solid, [&](const Vector3d& x) -> Vector3d { return factor * x; }),
              kExact);
  }
}

TEST_P(RealMesh, ShrinksFreelyWithoutStressUnderUniformEigenstrain) {
  constexpr double s = 0.05;
  ElasticLoads loads;
  loads.shrinkage = [](const Vector3d&, double load_factor) { return s * load_factor; };
  ElasticSolid solid(mesh, 2);
  const ElasticReport report = solve(solid, loads);
  EXPECT_LT(error_to_rigid_motion(solid, [](const Vector3d& x) -> Vector3d { return -s * x; }),
            kSolverTolerance);
  const double unrelaxed = kMaterial.E * s * s * volume(mesh.X, mesh.F);
  EXPECT_LT(report.elastic_energy, 1e-14 * unrelaxed);
}

TEST_P(RealMesh, BendsAndTwistsExactlyWithQuadraticElements) {
  const double E = kMaterial.E, nu = kMaterial.nu, mu = LameConstants(kMaterial).mu;
  const std::pair<Field, StressField> fields[] = {
      {[=](const Vector3d& x) -> Vector3d {
         return {x(0) * x(2), -nu * x(1) * x(2), -(x(0) * x(0) + nu * x(2) * x(2) - nu * x(1) * x(1)) / 2};
       },
       [=](const Vector3d& x) -> Matrix3d {
         Matrix3d sigma = Matrix3d::Zero();
         sigma(0, 0) = E * x(2);
         return sigma;
       }},
      {[](const Vector3d& x) -> Vector3d {
         return {-x(1) * x(2), x(0) * x(2), 0};
       },
       [=](const Vector3d& x) -> Matrix3d {
         Matrix3d sigma = Matrix3d::Zero();
         sigma(0, 2) = sigma(2, 0) = -mu * x(1);
         sigma(1, 2) = sigma(2, 1) = mu * x(0);
         return sigma;
       }}};
  for (const auto& [displacement, stress] : fields) {
    ElasticSolid solid(mesh, 2);
    solve(solid, tractions(stress, mesh));
    EXPECT_LT(error_to_rigid_motion(solid, displacement), kSolverTolerance);
  }
}

TEST(ElasticSolid, SolvesLargeBodiesByMultigrid) {
  const TetMesh mesh = box_tets(40, 17, 17, 0.25, 0.1);
  const Field linear = [](const Vector3d& x) -> Vector3d {
    return -(1 - 2 * kMaterial.nu) * 2 / kMaterial.E * x;
  };
  const ElasticLoads pressure =
      tractions([](const Vector3d&) -> Matrix3d { return -2 * Matrix3d::Identity(); }, mesh);
  ElasticSolid solid(mesh, 1);
  ElasticReport report = solve(solid, pressure);
  EXPECT_NE(report.solver.find("multigrid"), std::string::npos) << report.solver;
  EXPECT_LT(report.linear_iterations, 36);
  EXPECT_LT(error_to_rigid_motion(solid, linear), kSolverTolerance);

  std::set<int> end;
  for (int i = 0; i < mesh.X.cols(); ++i)
    if (mesh.X(0, i) < 0.2) end.insert(i);
  report = solve(solid, pressure, hold(solid, end, linear));
  EXPECT_LT(report.linear_iterations, 36);
  EXPECT_LT(largest_error(solid.X(), solid.displacement(), linear), kSolverTolerance);
}

// Measured: up to 139, as the kernels of BLAS round. Multigrid on degree 1 would take 199 iterations.
TEST(ElasticSolid, FactorisesDegreeOneOfALongBody) {
  const TetMesh mesh = box_tets(300, 5, 5, 0.5, 0.2);
  ElasticSolid solid(mesh, 2);
  const StressField bending = [](const Vector3d& x) -> Matrix3d {
    return Vector3d(x.y() - 0.5, 0, 0).asDiagonal();
  };
  const ElasticReport report = solve(solid, tractions(bending, mesh));
  EXPECT_NE(report.solver.find("Cholesky on degree 1"), std::string::npos) << report.solver;
  EXPECT_LT(report.linear_iterations, 165);
}

// A wrong transfer between the levels still ends at the solution, in many more iterations.
TEST(ElasticSolid, SolvesQuadraticElementsByTwoLevelsInFewIterations) {
  constexpr int kIterations = 36;  // measured: 28
  const TetMesh mesh = box_tets(8, 3, 3, 0.5, 0.1);
  const Field linear = [](const Vector3d& x) -> Vector3d {
    return -(1 - 2 * kMaterial.nu) * 2 / kMaterial.E * x;
  };
  const ElasticLoads pressure =
      tractions([](const Vector3d&) -> Matrix3d { return -2 * Matrix3d::Identity(); }, mesh);
  ElasticSolid solid(mesh, 2);
  ElasticReport report = solve(solid, pressure);
  EXPECT_NE(report.solver.find("two levels"), std::string::npos) << report.solver;
  EXPECT_LE(report.linear_iterations, kIterations);
  EXPECT_LT(error_to_rigid_motion(solid, linear), kSolverTolerance);

  std::set<int> end;
  for (int i = 0; i < solid.X().cols(); ++i)
    if (solid.X()(0, i) < 0.2) end.insert(i);
  report = solve(solid, pressure, hold(solid, end, linear));
  EXPECT_LE(report.linear_iterations, kIterations);
  EXPECT_LT(largest_error(solid.X(), solid.displacement(), linear), kSolverTolerance);
}

// Without correcting their nodes together it takes several times as many.
TEST(ElasticSolid, SolvesByTwoLevelsBesideFlatTetrahedraInFewIterations) {
  const auto iterations_with = [](double part_of_volume) {
    TetMesh mesh = box_tets(8, 3, 3, 0.5, 0.1);
    if (part_of_volume < 1) meshing::add_flat_tetrahedra(mesh, part_of_volume);
    ElasticSolid solid(mesh, 2);
    const ElasticReport report = solve(
        solid,
        tractions([](const Vector3d& x) -> Matrix3d { return Vector3d(x.y() - 0.7, 0, 0).asDiagonal(); },
                  mesh));
    EXPECT_NE(report.solver.find("two levels"), std::string::npos) << report.solver;
    return report.linear_iterations;
  };
  const int even = iterations_with(1);
  for (const double part_of_volume : {1e-2, 1e-3}) EXPECT_LT(iterations_with(part_of_volume), 1.5 * even);
}

// Their stiffness is beyond single precision, in which iterations stand still with any factor, and the rounding of their
// forces beyond a tolerance that others meet.
TEST(ElasticSolid, SolvesBesideFlatTetrahedraInDoublePrecision) {
  const Field linear = [](const Vector3d& x) -> Vector3d {
    return -(1 - 2 * kMaterial.nu) * 2 / kMaterial.E * x;
  };
  for (const double part_of_volume : {1e-8, 1e-10, 1e-12}) {
    TetMesh mesh = box_tets(8, 3, 3, 0.5, 0.1);
    meshing::add_flat_tetrahedra(mesh, part_of_volume);
    const ElasticLoads pressure =
        tractions([](const Vector3d&) -> Matrix3d { return -2 * Matrix3d::Identity(); }, mesh);
    ElasticSolid solid(mesh, 2);
    const ElasticReport report = solve(solid, pressure);
    EXPECT_NE(report.solver.find("Cholesky of all"), std::string::npos) << report.solver;
    EXPECT_LT(error_to_rigid_motion(solid, linear), kSolverTolerance) << part_of_volume;
  }
}

TEST(ElasticSolid, MakesAnotherFactorBesideFlatTetrahedraForOtherSupports) {
  TetMesh mesh = box_tets(8, 3, 3, 0.5, 0.1);
  meshing::add_flat_tetrahedra(mesh, 1e-8);
  const ElasticLoads pressure =
      tractions([](const Vector3d&) -> Matrix3d { return -2 * Matrix3d::Identity(); }, mesh);
  ElasticSolid used(mesh, 2), fresh(mesh, 2);
  solve(used, pressure);
  std::set<int> end;
  for (int i = 0; i < used.X().cols(); ++i)
    if (used.X()(0, i) < 0.2) end.insert(i);
  const auto held = hold(used, end, [](const Vector3d&) -> Vector3d { return Vector3d::Zero(); });
  const ElasticReport after = solve(used, pressure, held), alone = solve(fresh, pressure, held);
  EXPECT_EQ(after.linear_iterations, alone.linear_iterations);
  EXPECT_TRUE(used.displacement() == fresh.displacement());
}

TEST(ElasticSolid, SolvesAFreeBodyWhoseLoadsBalanceToNineDigits) {
  const TetMesh mesh = box_tets(8, 3, 3, 0.5, 0.1);
  ElasticLoads loads = tractions([](const Vector3d&) -> Matrix3d { return -2 * Matrix3d::Identity(); }, mesh);
  loads.body_force = [](const Vector3d&) { return Vector3d(1e-9, 0, 0); };
  ElasticSolid solid(mesh, 2);
  solve(solid, loads);
}

// Rounding along rigid motions would take a quarter more of them.
TEST(ElasticSolid, TakesFewIterationsForASlenderFreeBody) {
  const TetMesh mesh = box_tets(100, 2, 2, 0.5, 0.2);
  ElasticSolid solid(mesh, 2);
  const StressField bending = [](const Vector3d& x) -> Matrix3d {
    return Vector3d(x.y() - 0.5, 0, 0).asDiagonal();
  };
  EXPECT_LT(solve(solid, tractions(bending, mesh)).linear_iterations, 110);
}

TEST(ElasticSolid, LeavesNoRigidMotionInAFreeBody) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.1);
  ElasticSolid solid(mesh, 2);
  solve(solid, tractions([](const Vector3d&) -> Matrix3d { return Matrix3d::Ones(); }, mesh));
  const Eigen::SparseMatrix<double> M = solid.mass();
  const Eigen::VectorXd momentum = M * solid.displacement().reshaped();
  Vector3d total = Vector3d::Zero();
  for (int i = 0; i < solid.X().cols(); ++i) total += momentum.segment<3>(3 * i);
  EXPECT_LT(total.norm(), 1e-12 * momentum.norm());
  EXPECT_GT(solid.displacement().norm(), 0);
}

// Corrections go astray in a plate so thin. What they lead to is no measure of what is left.
TEST(ElasticSolid, TellsTheResidualOverTheLoad) {
  constexpr double kThin = 0.03;
  TetMesh mesh = box_tets(12, 12, 1, 1. / 12);
  mesh.X.row(2) *= kThin;
  ElasticSolid solid(mesh, 2);
  const StressField bending = [](const Vector3d& x) -> Matrix3d {
    return Vector3d(x.z() / kThin - 0.5 / 12, 0, 0).asDiagonal();
  };
  const ElasticReport report = solve(solid, tractions(bending, mesh));
  const Eigen::VectorXd load = solid.load();
  const double rest = (load - solid.linearise(solid.displacement(), 1, false).force).norm();
  EXPECT_LT(rest, 1e-3 * load.norm());
  EXPECT_NEAR(report.residual * 2 * load.norm() / rest, 1, 0.1) << report.solver << report.residual;
}

TEST(ElasticSolid, NamesTheRigidMotionsThatLoadsDrive) {
  ElasticSolid solid(box_tets(2, 1, 1, 1), 2);
  ElasticLoads gravity;
  gravity.body_force = [](const Vector3d&) { return Vector3d(0, -1, 0); };
  std::vector<ConstrainedComponent> only_x;  // holds the shift along x and the turns about y and z
  for (int i = 0; i < solid.X().cols(); ++i)
    if (solid.X()(0, i) == 0) only_x.push_back({i, 0, 0});
  try {
    solid.assemble(kMaterial, ElasticLaw::SmallStrain, gravity, only_x);
    solid.solve();
    FAIL() << "a free body fell without a word";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(
        std::string(error.what()).find("3 rigid motions free (shift along y, shift along z, turn about x)"),
        std::string::npos)
        << error.what();
  }
}

// A cubic traction on the end of a box, against a field that quadratic elements hold whole: it does the work
// 1/6 along y^2 and 1/10 along y z, the integrals of y^5 and y^4 z.
TEST(ElasticSolid, IntegratesCubicTractionsExactly) {
  constexpr double kRounding = 1e-13;
  const TetMesh mesh = box_tets(1, 1, 1, 1);
  const Matrix3Xd areas = area_vectors(mesh.X, mesh.F);
  ElasticLoads loads;
  loads.traction = [areas](const Vector3d& x, int f) -> Vector3d {
    return {areas(0, f) > 0.1 ? std::pow(x(1), 3) : 0, 0, 0};
  };
  ElasticSolid solid(mesh, 2);
  solid.assemble(kMaterial, ElasticLaw::SmallStrain, loads, {});
  const Eigen::VectorXd load = solid.load();
  double squared = 0, mixed = 0;
  for (int i = 0; i < solid.X().cols(); ++i) {
    const double y = solid.X()(1, i), z = solid.X()(2, i);
    squared += load(3 * i) * y * y;
    mixed += load(3 * i) * y * z;
  }
  EXPECT_NEAR(squared, 1. / 6, kRounding);
  EXPECT_NEAR(mixed, 1. / 10, kRounding);
}

// A bar pulled at one end: its stress falls linearly to the other, u_x = t x^2 / (2 E L).
TEST(ElasticSolid, StretchesWhatInertiaHolds) {
  constexpr double t = 5, L = 2;
  const TetMesh mesh = box_tets(4, 2, 2, 0.5);
  const Matrix3Xd areas = area_vectors(mesh.X, mesh.F);
  ElasticLoads pull;
  pull.traction = [areas](const Vector3d& x, int f) -> Vector3d {
    return {x(0) > L - 1e-9 && areas(0, f) > 0.9 * areas.col(f).norm() ? t : 0, 0, 0};
  };
  const Material material{1000, 0, 3, 0};
  ElasticSolid solid(mesh, 2);
  solid.assemble(material, ElasticLaw::SmallStrain, pull, {});
  solid.relieve_inertia();
  ASSERT_TRUE(solid.solve().is_converged);
  EXPECT_LT(error_to_rigid_motion(solid,
                                  [&](const Vector3d& x) -> Vector3d {
                                    return {t * x(0) * x(0) / (2 * material.E * L), 0, 0};
                                  }),
            kSolverTolerance);
}

TEST(ElasticSolid, RefusesInvertedTetrahedra) {
  TetMesh mesh = box_tets(1, 1, 1, 1);
  mesh.T.col(3).tail<2>().reverseInPlace();
  try {
    const ElasticSolid solid(mesh, 1);
    FAIL() << "solved on an inverted tetrahedron";
  } catch (const std::runtime_error& error) {
    std::ostringstream nodes;
    nodes << "tetrahedron 3 of nodes " << mesh.T.col(3).transpose() << ": volume -";
    EXPECT_EQ(std::string(error.what()).find(nodes.str()), 0u) << error.what();
  }
}

TEST(ElasticSolid, RotatesWithItsScene) {
  const Matrix3d R = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  TetMesh mesh = box_tets(3, 1, 1, 1), rotated = mesh;
  rotated.X = R * mesh.X;
  const auto sag = [](const TetMesh& body, const Matrix3d& frame, ElasticLaw law) {
    ElasticSolid solid(body, 2);
    std::set<int> end;
    for (int i = 0; i < solid.X().cols(); ++i)
      if (std::abs((frame.transpose() * solid.X().col(i))(0)) < 1e-12) end.insert(i);
    ElasticLoads loads;
    loads.body_force = [frame](const Vector3d&) -> Vector3d { return frame * Vector3d(0, -5, 2); };
    solve(solid, loads, hold(solid, end, [](const Vector3d&) -> Vector3d { return Vector3d::Zero(); }), law);
    return solid.displacement();
  };
  for (ElasticLaw law : {ElasticLaw::SmallStrain, ElasticLaw::StVenantKirchhoff, ElasticLaw::NeoHookean}) {
    const Matrix3Xd u = sag(mesh, Matrix3d::Identity(), law), v = sag(rotated, R, law);
    EXPECT_GT(u.colwise().norm().maxCoeff(), 0.1);
    EXPECT_LT((R * u - v).norm(), kSolverTolerance * u.norm());
  }
}

}  // namespace
}  // namespace testbed::fem
