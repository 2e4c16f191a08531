// Coupled springs far from rest, by the quasi-static solver.
#include <gtest/gtest.h>

#include <cmath>

#include "massspring/calibrations/calibrate.h"
#include "massspring/statics/linear_statics.h"
#include "massspring/statics/quasi_static.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr int kLoadSteps = 10;

MassSpringModel cube(int n, const std::string& name, double nu) {
  const TetMesh mesh = box_tets(n, n, n, 1. / n, 0.1);
  Material material;
  material.nu = nu;
  return calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface}, material,
                   find_calibration(name));
}

Forces no_forces(const MassSpringModel& model) {
  Forces forces;
  forces.load = Matrix3Xd::Zero(3, model.network.X.cols());
  return forces;
}

bool is_inner(int i, int n) {
  for (int k = 0, rest = i; k < 3; ++k, rest /= n + 1)
    if (rest % (n + 1) == 0 || rest % (n + 1) == n) return false;
  return true;
}

struct Outcome {
  State state;
  int newton_iterations = 0;
  bool is_ok = true;
};

Outcome solve(const MassSpringModel& model, const Forces& forces) {
  Outcome outcome{initial_state(model)};
  QuasiStaticSolver solver(model, forces);
  for (int k = 1; k <= kLoadSteps; ++k) {
    const StepReport report = solver.solve(static_cast<double>(k) / kLoadSteps, outcome.state);
    outcome.newton_iterations += report.newton_iterations;
    outcome.is_ok = outcome.is_ok && report.status == Status::Ok;
  }
  return outcome;
}

double smallest_tet_jacobian(const MassSpringModel& model, const State& state) {
  return smallest_jacobian(couple_springs(model.network.X, model.network.T, {1, 1}, kEdgeCoupled),
                           displacement(model, state));
}

class CoupledModel : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(LargeStrain, CoupledModel, testing::Values("edge_coupled", "node_averaged"),
                         [](const auto& info) { return info.param; });

TEST_P(CoupledModel, HomogeneousBoundaryGivesHomogeneousInside) {
  constexpr double kTolerance = 1e-7;  // Newton stops at a residual of 1e-9
  constexpr int n = 3;
  const Matrix3d crushed = (Matrix3d() << 1.1, 0, 0.2, 0, 1.1, 0, 0, 0, 0.4).finished();
  const Matrix3d inflated = std::cbrt(3) * Matrix3d::Identity(), deflated = 0.6 * Matrix3d::Identity();
  for (const Matrix3d& F : {crushed, inflated, deflated}) {
    const MassSpringModel model = cube(n, GetParam(), 0.3);
    Forces forces = no_forces(model);
    const Matrix3Xd target = F * model.network.X;
    for (int i = 0; i < target.cols(); ++i)
      if (!is_inner(i, n))
        forces.constraints.push_back({i, Matrix3d::Zero(), target.col(i) - model.network.X.col(i)});
    const Outcome outcome = solve(model, forces);
    EXPECT_TRUE(outcome.is_ok);
    EXPECT_LT((outcome.state.x - target).norm(), kTolerance);
  }
}

TEST_P(CoupledModel, SixtyPercentCrushAndThreefoldStretchConvergeWithoutInversion) {
  constexpr int n = 4, kMostNewtonIterations = 8 * kLoadSteps;
  for (double nu : {0.25, 0.45})
    for (double shift : {-0.6, 2.}) {
      const MassSpringModel model = cube(n, GetParam(), nu);
      Forces forces = no_forces(model);
      const int layer = (n + 1) * (n + 1);
      for (int i = 0; i < layer; ++i) {
        forces.constraints.push_back({i, Matrix3d::Zero(), Vector3d::Zero()});
        forces.constraints.push_back({n * layer + i, Matrix3d::Zero(), Vector3d(0, 0, shift)});
      }
      const Outcome outcome = solve(model, forces);
      EXPECT_TRUE(outcome.is_ok) << "nu " << nu << " shift " << shift;
      EXPECT_GT(smallest_tet_jacobian(model, outcome.state), 0) << "nu " << nu << " shift " << shift;
      EXPECT_LT(outcome.newton_iterations, kMostNewtonIterations);
    }
}

TEST_P(CoupledModel, PullThatFollowsTheSurfaceInflatesByTheLaw) {
  constexpr int n = 3;
  constexpr double kVolumeRatio = 1.4, kStretch = 1.1186889420813968;  // its cube root
  constexpr double kTolerance = 1e-6;
  constexpr int kMostNewtonIterations = 5 * kLoadSteps;  // quadratic: the pull's own stiffness counts
  const MassSpringModel model = cube(n, GetParam(), 0.3);
  const auto [lambda, mu] = lame_of(model.material);
  Forces forces = no_forces(model);
  forces.constraints = hold_rigid_motion(model.network.X);
  const double pull = mu / kStretch + lambda / 2 * kVolumeRatio - (mu + lambda / 2) / kVolumeRatio;
  forces.surface.push_back(std::make_shared<FollowerPressure>(-pull, Faces{model.network.F}));
  const Outcome outcome = solve(model, forces);
  EXPECT_TRUE(outcome.is_ok);
  EXPECT_LT(outcome.newton_iterations, kMostNewtonIterations);
  EXPECT_NEAR(volume(outcome.state.x, model.network.F),
              kVolumeRatio * volume(model.network.X, model.network.F), kTolerance);
}

}  // namespace
}  // namespace testbed::massspring
