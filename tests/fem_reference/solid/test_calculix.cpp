// The reference against CalculiX on the same tetrahedra, to the digits that it prints.
#include <gtest/gtest.h>

#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solid/natural_modes.h"
#include "meshing/base/geometry.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tet_mesh.h"
#include "meshing/tetrahedra/tetrahedralize.h"
#include "tests/fem_reference/calculix.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kPrinted = 1e-6;  // of seven digits, relative to the largest value
const Material kMaterial{1000, 0.3, 2, 0};

class AgainstCalculix : public testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    if (!has_calculix()) GTEST_SKIP() << "ccx is not installed (Debian package calculix-ccx)";
  }
};
INSTANTIATE_TEST_SUITE_P(Degree, AgainstCalculix, testing::Values(1, 2));

/// Nodes with the least x constrained, in place or moved.
std::vector<ConstrainedComponent> clamp(const ElasticSolid& solid, double from, double to,
                                        const Vector3d& displacement = Vector3d::Zero()) {
  std::vector<ConstrainedComponent> constrained;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3 && solid.X()(0, i) >= from && solid.X()(0, i) <= to; ++c)
      constrained.push_back({i, c, displacement(c)});
  return constrained;
}

/// Pressure p on the triangles whose outward normal has a positive y.
std::vector<std::pair<int, double>> pressure_from_above(const TetMesh& mesh, double p) {
  std::vector<std::pair<int, double>> pressures;
  const Matrix3Xd areas = area_vectors(mesh.X, mesh.F);
  for (int f = 0; f < areas.cols(); ++f)
    if (areas(1, f) > 0.5 * areas.col(f).norm()) pressures.push_back({f, p});
  return pressures;
}

ElasticLoads loads_of(const CalculixJob& job, const TetMesh& mesh) {
  Matrix3Xd traction = Matrix3Xd::Zero(3, mesh.F.cols());
  const Matrix3Xd areas = area_vectors(mesh.X, mesh.F);
  for (const auto& [f, p] : job.pressures) traction.col(f) = -p * areas.col(f).normalized();
  ElasticLoads loads;
  loads.traction = [traction](const Vector3d&, int f) -> Vector3d { return traction.col(f); };
  loads.body_force = [force = Vector3d(job.material.rho * job.gravity)](const Vector3d&) { return force; };
  return loads;
}

Matrix3Xd solve(ElasticSolid& solid, ElasticLaw law, const CalculixJob& job) {
  solid.assemble(job.material, law, loads_of(job, solid.mesh()), job.constrained);
  EXPECT_TRUE(solid.solve().is_converged);
  return solid.displacement();
}

double difference(const Matrix3Xd& u, const Matrix3Xd& v) {
  return (u - v).cwiseAbs().maxCoeff() / u.cwiseAbs().maxCoeff();
}

TEST_P(AgainstCalculix, SagsAndBendsAlike) {
  const TetMesh mesh = box_tets(6, 3, 2, 0.5, 0.15);
  ElasticSolid solid(mesh, GetParam());
  CalculixJob job;
  job.material = kMaterial;
  job.constrained = clamp(solid, -1, 0.1);
  for (const ConstrainedComponent& h : clamp(solid, 2.9, 4, {0.1, 0, 0.02})) job.constrained.push_back(h);
  job.gravity = {0, -9.81, 1};
  job.pressures = pressure_from_above(mesh, 3);
  EXPECT_LT(difference(solve(solid, ElasticLaw::SmallStrain, job), run_calculix(solid, job).u), kPrinted);
}

TEST_P(AgainstCalculix, DeformsARealMeshAlike) {
  const TetMesh mesh = tetrahedralize(make_shape("torus", 400));
  ElasticSolid solid(mesh, GetParam());
  CalculixJob job;
  job.material = kMaterial;
  const double low = mesh.X.row(0).minCoeff(), size = mesh.X.row(0).maxCoeff() - low;
  job.constrained = clamp(solid, low, low + 0.2 * size);
  job.gravity = {0, -1, 0};
  job.pressures = pressure_from_above(mesh, 2);
  EXPECT_LT(difference(solve(solid, ElasticLaw::SmallStrain, job), run_calculix(solid, job).u), kPrinted);
}

/// Mass by the rule with which CalculiX integrates it for frequencies: too few points, 1 on linear and 4 on
/// quadratic tetrahedra, where the reference's is exact.
Eigen::SparseMatrix<double> mass_of_few_points(const ElasticSolid& solid, double rho) {
  const double b = (5 - std::sqrt(5)) / 20;
  Eigen::Matrix4Xd points = Eigen::Vector4d::Constant(0.25);
  if (solid.cells().rows() == 10)
    points = Eigen::Matrix4d::Constant(b) + (1 - 4 * b) * Eigen::Matrix4d::Identity();
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd N;
  Eigen::MatrixXd dN;
  for (const auto& cell : solid.cells().colwise()) {
    const double weight = rho * tet_volume(solid.X(), cell.head<4>()) / static_cast<double>(points.cols());
    for (const auto& at : points.colwise()) {
      shape_functions(static_cast<int>(cell.size()), at, N, dN);
      for (int i = 0; i < cell.size(); ++i)
        for (int j = 0; j < cell.size(); ++j)
          for (int c = 0; c < 3; ++c)
            entries.emplace_back(3 * cell(i) + c, 3 * cell(j) + c, weight * N(i) * N(j));
    }
  }
  Eigen::SparseMatrix<double> M(solid.n_dofs(), solid.n_dofs());
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

TEST_P(AgainstCalculix, VibratesAlikeWithItsMass) {
  const TetMesh mesh = box_tets(6, 3, 2, 0.5, 0.15);
  ElasticSolid solid(mesh, GetParam());
  CalculixJob job;
  job.material = kMaterial;
  job.constrained = clamp(solid, -1, 0.1);
  job.n_frequencies = 8;
  solid.assemble(job.material, ElasticLaw::SmallStrain, {}, job.constrained);
  std::vector<int> constrained;
  for (const ConstrainedComponent& h : job.constrained) constrained.push_back(3 * h.node + h.component);
  const Modes modes = natural_modes(solid.stiffness(), mass_of_few_points(solid, kMaterial.rho), constrained,
                                    job.n_frequencies);
  const std::vector<double> expected = run_calculix(solid, job).frequencies;
  ASSERT_EQ(static_cast<int>(expected.size()), job.n_frequencies);
  for (int k = 0; k < job.n_frequencies; ++k)
    EXPECT_NEAR(modes.frequency(k), expected[k], kPrinted * expected[k]);
}

TEST_P(AgainstCalculix, BendsFarAlikeAtFiniteStrain) {
  const TetMesh mesh = box_tets(8, 2, 2, 0.5, 0.15);
  ElasticSolid solid(mesh, GetParam());
  CalculixJob job;
  job.material = kMaterial;
  job.is_finite_strain = true;
  job.constrained = clamp(solid, -1, 0.1);
  job.gravity = {0, -1.5, 0.3};
  const Matrix3Xd u = solve(solid, ElasticLaw::StVenantKirchhoff, job);
  EXPECT_GT(u.cwiseAbs().maxCoeff(), 0.5);  // an eighth of the length: far from small
  EXPECT_LT(difference(u, run_calculix(solid, job).u), kPrinted);
}

// CalculiX's error here falls with the square of its increments. Linear triangles stay flat; on curved ones
// it has too few points.
TEST_P(AgainstCalculix, InflatesAlikeUnderAPressureThatFollows) {
  const TetMesh mesh = box_tets(5, 3, 2, 0.5, 0.15);
  ElasticSolid solid(mesh, GetParam());
  CalculixJob job;
  job.material = kMaterial;
  job.is_finite_strain = true;
  job.increment = GetParam() == 1 ? 0.004 : 0.04;
  job.constrained = clamp(solid, -1, 0.1);
  for (int f = 0; f < mesh.F.cols(); ++f) job.pressures.push_back({f, -75});
  ElasticLoads loads = loads_of(job, mesh);
  loads.traction = nullptr;
  loads.follower_pressure = [](int) { return -75.0; };
  solid.assemble(job.material, ElasticLaw::StVenantKirchhoff, loads, job.constrained);
  const ElasticReport report = solid.solve();
  ASSERT_TRUE(report.is_converged);
  const double strain = largest_stretch(solid.X(), solid.cells(), solid.displacement());
  EXPECT_GT(strain, 0.05);
  EXPECT_NEAR(report.max_strain, strain, 1e-12);
  EXPECT_LT(difference(solid.displacement(), run_calculix(solid, job).u), GetParam() == 1 ? kPrinted : 1e-3);
}

}  // namespace
}  // namespace testbed::fem
