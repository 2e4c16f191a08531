#include <gtest/gtest.h>

#include <stdexcept>

#include "massspring/energies/tractions.h"
#include "massspring/statics/diagnostics.h"
#include "massspring/statics/exact_fields.h"
#include "massspring/statics/linear_statics.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

MassSpringModel solid(const Blend& blend) {
  const TetMesh mesh = box_tets(3, 3, 8, 0.4, 0.15);
  MassSpringModel model;
  model.network = mesh;
  model.material.nu = 0.3;
  model.tet_springs = couple_springs(mesh.X, mesh.T, lame_of(model.material), blend);
  return model;
}

TEST(Diagnostics, PatchTestsAreExactForCoupledSprings) {
  constexpr double kPatchTolerance = 1e-9;  // the linear solver stops at 1e-10
  for (const Blend& blend : {kEdgeCoupled, kNodeAveraged}) {
    const Diagnostics d = diagnose(solid(blend));
    EXPECT_LT(d.pressure_error, kPatchTolerance);
    EXPECT_LT(d.uniaxial_error, kPatchTolerance);
  }
}

TEST(Diagnostics, ShowThatSingleTetrahedraAreTooStiffAndAveragesNearlyRight) {
  const Diagnostics p1 = diagnose(solid(kEdgeCoupled)), averaged = diagnose(solid(kNodeAveraged));
  EXPECT_LT(p1.bending_compliance, 0.96);
  EXPECT_NEAR(averaged.bending_compliance, 1, 0.02);
  EXPECT_LT(p1.torsion_compliance, 0.98);
  EXPECT_NEAR(averaged.torsion_compliance, 1, 0.02);
  EXPECT_LT(averaged.node_error.mean(), p1.node_error.mean() / 2);
}

TEST(Diagnostics, SeeAFalseStiffness) {
  MassSpringModel model = solid(kNodeAveraged);
  model.tet_springs->mu *= 1.1;
  const Diagnostics d = diagnose(model);
  EXPECT_GT(d.uniaxial_error, 0.01);
  EXPECT_LT(d.torsion_compliance, diagnose(solid(kNodeAveraged)).torsion_compliance / 1.05);
}

// A false shear modulus leaves linear fields linear.
TEST(Diagnostics, PatchTestsAreOffByTheRatioOfTheModuli) {
  constexpr double kSolved = 1e-8;  // the linear solver stops at 1e-10
  MassSpringModel model = solid(kNodeAveraged);
  const auto& [X, T, F, n_surface] = model.network;
  const auto [lambda, mu] = lame_of(model.material);
  const double false_mu = 1.1 * mu, bulk = lambda + 2 * mu / 3, false_bulk = lambda + 2 * false_mu / 3;
  model.tet_springs->mu = false_mu;
  const Diagnostics d = diagnose(model);
  EXPECT_NEAR(d.pressure_error, 1 - bulk / false_bulk, kSolved);

  const ExactField tension = exact_field("uniaxial", {lambda, mu}, Eigen::Vector3d::Zero());
  const double stress = tension.stress({0, 0, 0})(0, 0), along = stress / 9 * (1 / false_bulk + 3 / false_mu),
               across = stress / 9 * (1 / false_bulk - 3 / (2 * false_mu));
  const Eigen::Matrix3Xd u = Eigen::Vector3d(along, across, across).asDiagonal() * X;
  EXPECT_NEAR(d.uniaxial_error, surface_error(u, displacements(tension, X), X, F).l2, kSolved);
}

TEST(Diagnostics, NodesShowTheLargerErrorAndCompliancesTheWorkOfBendingAndTorsion) {
  constexpr double kSolved = 1e-8;
  const MassSpringModel model = solid(kEdgeCoupled);
  const auto& [X, T, F, n_surface] = model.network;
  LinearStatics statics(model, hold_rigid_motion(X));
  Eigen::VectorXd error[2];
  double compliance[2];
  for (int k : {0, 1}) {
    const ExactField field =
        exact_field(k == 0 ? "bending" : "torsion", lame_of(model.material), X.rowwise().mean());
    const Eigen::Matrix3Xd f = traction_forces(field.stress, X, F), exact = displacements(field, X);
    Eigen::Matrix3Xd u;
    statics.solve(f, u, 1e-12);
    error[k] = node_errors(u, exact, X);
    compliance[k] = f.cwiseProduct(u).sum() / f.cwiseProduct(exact).sum();
  }
  ASSERT_GT((error[0] - error[1]).maxCoeff(), 1e-3);
  ASSERT_GT((error[1] - error[0]).maxCoeff(), 1e-3);
  const Diagnostics d = diagnose(model);
  EXPECT_LT((d.node_error - error[0].cwiseMax(error[1])).norm(), kSolved);
  EXPECT_NEAR(d.bending_compliance, compliance[0], kSolved);
  EXPECT_NEAR(d.torsion_compliance, compliance[1], kSolved);
}

TEST(Diagnostics, RefuseAFloppyModel) {
  MassSpringModel model = solid(kNodeAveraged);
  model.tet_springs.reset();
  model.springs = Springs{Eigen::Vector2i(0, 1), Eigen::VectorXd::Ones(1), 0};
  EXPECT_THROW(diagnose(model), std::runtime_error);
}

}  // namespace
}  // namespace testbed::massspring
