#include <gtest/gtest.h>

#include <stdexcept>

#include "massspring/diagnostics.h"
#include "tests/massspring/box_tets.h"

namespace testbed {
namespace {

MassSpringModel solid(const Blend& blend) {
  const TetMesh mesh = box_tets(3, 3, 8, 0.4, 0.15);
  MassSpringModel model;
  model.network = {mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface};
  model.material.nu = 0.3;
  model.tet_springs = couple_springs(mesh.X, mesh.T, lame_of(model.material), blend);
  return model;
}

TEST(Diagnostics, PatchTestsAreExactForCoupledSprings) {
  constexpr double patch_tolerance = 1e-9;  // the linear solver stops at 1e-10
  for (const Blend& blend : {edge_coupled, node_averaged}) {
    const Diagnostics d = diagnose(solid(blend));
    EXPECT_LT(d.pressure_error, patch_tolerance);
    EXPECT_LT(d.uniaxial_error, patch_tolerance);
  }
}

TEST(Diagnostics, ShowThatSingleTetrahedraAreTooStiffAndAveragesNearlyRight) {
  const Diagnostics p1 = diagnose(solid(edge_coupled)), averaged = diagnose(solid(node_averaged));
  EXPECT_LT(p1.bending_compliance, 0.96);
  EXPECT_NEAR(averaged.bending_compliance, 1, 0.02);
  EXPECT_LT(p1.torsion_compliance, 0.98);
  EXPECT_NEAR(averaged.torsion_compliance, 1, 0.02);
  EXPECT_LT(averaged.node_error.mean(), p1.node_error.mean() / 2);
}

TEST(Diagnostics, SeeAFalseStiffness) {
  MassSpringModel model = solid(node_averaged);
  model.tet_springs->mu *= 1.1;
  const Diagnostics d = diagnose(model);
  EXPECT_GT(d.uniaxial_error, 0.01);
  EXPECT_LT(d.torsion_compliance, diagnose(solid(node_averaged)).torsion_compliance / 1.05);
}

TEST(Diagnostics, RefuseAFloppyModel) {
  MassSpringModel model = solid(node_averaged);
  model.tet_springs.reset();
  model.network.E = Eigen::Matrix2Xi::Zero(2, 1);
  model.network.E(1, 0) = 1;
  model.springs = Springs{model.network.E, Eigen::VectorXd::Ones(1), 0};
  EXPECT_THROW(diagnose(model), std::runtime_error);
}

}  // namespace
}  // namespace testbed
