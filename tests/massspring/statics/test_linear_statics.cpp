#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "massspring/energies/tractions.h"
#include "massspring/statics/exact_fields.h"
#include "massspring/statics/linear_statics.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kPatchTolerance = 1e-10;   // the bar of the patch test
constexpr double kSolverTolerance = 1e-13;  // below it

MassSpringModel solid(const TetMesh& mesh, double nu, const Blend& blend) {
  MassSpringModel model;
  model.network = mesh;
  model.material.nu = nu;
  model.tet_springs = couple_springs(mesh.X, mesh.T, lame_of(model.material), blend);
  return model;
}

double field_error(const std::string& name, const MassSpringModel& model) {
  const auto& [X, T, F, n_surface] = model.network;
  const ExactField field = exact_field(name, lame_of(model.material), X.rowwise().mean());
  Matrix3Xd u;
  const SolveReport report = LinearStatics(model, hold_rigid_motion(X))
                                 .solve(traction_forces(field.stress, X, F), u, kSolverTolerance);
  EXPECT_TRUE(report.is_converged);
  return surface_error(u, displacements(field, X), X, F).l2;
}

TEST(PatchTest, LinearFieldsAreExactAtEveryPoissonRatio) {
  const TetMesh mesh = box_tets(4, 3, 3, 0.4, 0.2);
  for (double nu : {0., 0.25, 0.3, 0.45, 0.49, 0.499})
    for (const char* name : {"pressure", "uniaxial", "shear"})
      for (const Blend& blend : {kEdgeCoupled, kNodeAveraged})
        EXPECT_LT(field_error(name, solid(mesh, nu, blend)), kPatchTolerance) << name << " nu " << nu;
}

TEST(PatchTest, IsExactOnSoManyNodesThatMultigridPreconditions) {
  const MassSpringModel model = solid(box_tets(17, 18, 19, 0.4, 0.2), 0.3, kNodeAveraged);  // 6840 nodes
  EXPECT_LT(field_error("uniaxial", model), kPatchTolerance);
}

TEST(PatchTest, FailsWithAFalseWeight) {
  MassSpringModel model = solid(box_tets(4, 3, 3, 0.4, 0.2), 0.25, kNodeAveraged);
  model.tet_springs->volume[model.tet_springs->n_patches() / 2] *= 1.01;
  EXPECT_GT(field_error("uniaxial", model), 1e3 * kPatchTolerance);
}

TEST(LinearStatics, AveragingBeatsP1InBendingAndTorsion) {
  const TetMesh mesh = box_tets(4, 4, 16, 0.25, 0.15);
  for (double nu : {0.25, 0.49})
    for (const char* name : {"bending", "torsion"}) {
      const double p1 = field_error(name, solid(mesh, nu, kEdgeCoupled));
      EXPECT_LT(field_error(name, solid(mesh, nu, kNodeAveraged)), p1 / 2) << name << " nu " << nu;
    }
}

TEST(LinearStatics, ErrorFallsWithTheSquareOfTheSpacing) {
  constexpr double kLeastSlope = 1.7, kLargestSlope = 2.6;  // 2 in theory, on two coarse meshes
  for (const Blend& blend : {kEdgeCoupled, kNodeAveraged}) {
    const double coarse = field_error("torsion", solid(box_tets(6, 6, 6, 0.5), 0.3, blend));
    const double fine = field_error("torsion", solid(box_tets(12, 12, 12, 0.25), 0.3, blend));
    EXPECT_GT(std::log2(coarse / fine), kLeastSlope);
    EXPECT_LT(std::log2(coarse / fine), kLargestSlope);
  }
}

TEST(LinearStatics, RefusesABodyThatCanMove) {
  const MassSpringModel model = solid(box_tets(1, 1, 1, 1), 0.25, kEdgeCoupled);
  const Constraint pin{0, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()};  // the body turns about it
  EXPECT_THROW(LinearStatics(model, {pin}), std::runtime_error);
}

}  // namespace
}  // namespace testbed::massspring
