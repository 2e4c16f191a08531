#include <gtest/gtest.h>

#include "tests/stability/candidates.h"

namespace testbed::massspring {
namespace {

const Method& find_method(const std::string& name) {
  for (const Method& method : methods())
    if (method.name == name) return method;
  throw std::logic_error(name);
}

const Start& find_start(const std::string& name) {
  for (const Start& start : starts())
    if (start.name == name) return start;
  throw std::logic_error(name);
}

class Stability : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Ours, Stability,
                         testing::Values("minimising_definite_springs", "minimising_edge_coupled",
                                         "minimising_node_averaged"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(Stability, FromEveryStartStepsConvergeAndGainNoEnergy) {
  for (const Start& start : starts())
    for (const double h : {1e-3, 1e-1}) {
      constexpr double E = 1e5, kRounding = 1e-9;
      const Outcome outcome = run_cell(find_method(GetParam()), start, E, h);
      EXPECT_TRUE(outcome.name == "ok" || outcome.name == "short")
          << start.name << ' ' << h << ' ' << outcome.name;
      EXPECT_LE(outcome.energy_ratio, 1 + kRounding) << start.name << ' ' << h;
      EXPECT_GT(outcome.t, 0);
    }
}

// Nothing but a body's own inertia, a billionth of its stiffness, holds it from turning.
TEST(Stability, AStiffMirroredBodyTurnsBackInLongSteps) {
  for (const char* method : {"minimising_edge_coupled", "minimising_node_averaged"})
    for (const std::uint64_t seed : {1, 2}) {
      constexpr double E = 1e9, h = 1;
      const Outcome outcome = run_cell(find_method(method), find_start("mirrored"), E, h, seed);
      EXPECT_EQ(outcome.name, "ok") << method << ' ' << seed;
    }
}

// Bodies that buckle pass saddles, near which a Hessian kept positive is far too stiff.
TEST(Stability, AStiffBodyFromRandomPositionsComesPastItsSaddlesInLongSteps) {
  for (const double E : {1e7, 1e8}) {
    constexpr double h = 1;
    EXPECT_EQ(run_cell(find_method("minimising_node_averaged"), find_start("random"), E, h).name, "ok") << E;
  }
}

// The paper's network is a mechanism; stiff, it folds along valleys that bend too much for steps as long.
TEST(Stability, AStiffMechanismFoldsInHalvedSteps) {
  for (const char* start : {"crushed", "flattened"}) {
    constexpr double E = 1e9, h = 1;
    const Outcome outcome = run_cell(find_method("minimising_definite_springs"), find_start(start), E, h);
    EXPECT_EQ(outcome.name, "ok") << start;
  }
}

TEST(StabilityMap, TellsPatchesThatAreInsideOut) {
  // A millisecond in which nothing can turn: tetrahedra are what they were.
  for (const char* method : {"minimising_edge_coupled", "minimising_node_averaged"}) {
    EXPECT_NEAR(run_cell(find_method(method), find_start("squashed"), 1e3, 1e-4).least_patch, 0.5, 0.1);
    EXPECT_NEAR(run_cell(find_method(method), find_start("mirrored"), 1e3, 1e-4).least_patch, -1, 0.1);
  }
}

TEST(StabilityMap, TellsStableFromUnstableAndGainedEnergy) {
  // The body's stability limit is 4.4e-3 s.
  EXPECT_EQ(run_cell(find_method("symplectic_euler"), find_start("rest"), 1e4, 1e-3).name, "ok");
  EXPECT_EQ(run_cell(find_method("symplectic_euler"), find_start("rest"), 1e4, 1e-1).name, "diverged");
  EXPECT_EQ(run_cell(find_method("explicit_euler"), find_start("rest"), 1e4, 1e-3).name, "energy_gained");
  EXPECT_EQ(run_cell(find_method("explicit_euler"), find_start("mirrored"), 1e9, 1e-1).name, "diverged");
}

class CandidateLaws : public testing::TestWithParam<VolumeLaw> {};
INSTANTIATE_TEST_SUITE_P(Stability, CandidateLaws,
                         testing::Values(other_expansion(1), other_expansion(0.01), penalty(0.4, 150)));

TEST_P(CandidateLaws, HaveForcesAndHessiansThatAreDifferences) {
  constexpr double h = 1e-6, kTolerance = 1e-6;  // central differences: h^2 and rounding / h
  const TetMesh mesh = box_tets(2, 2, 2, 0.5, 0.15);
  const PatchVolumes volumes(couple_springs(mesh.X, mesh.T, {2, 1}, kNodeAveraged), mesh.X, GetParam());
  Random random(3);
  const Eigen::Matrix3Xd x = 0.3 * mesh.X + noise(mesh.X.cols(), 0.3, random);
  const auto force = [&](const Eigen::Matrix3Xd& at) {
    Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, at.cols());
    volumes.add_forces(at, f);
    return f;
  };
  const Eigen::Matrix3Xd f = force(x), d = noise(x.cols(), 1, random), ahead = x + h * d, behind = x - h * d;
  const double slope = (volumes.energy(ahead) - volumes.energy(behind)) / (2 * h);
  EXPECT_NEAR(-slope, f.cwiseProduct(d).sum(), kTolerance * f.norm() * d.norm());
  SurfaceHessian H;
  volumes.add_hessian(x, H, Curvature::Exact);
  Eigen::Matrix3Xd product = Eigen::Matrix3Xd::Zero(3, x.cols());
  H.add_product(d, product);
  EXPECT_LT((product + (force(ahead) - force(behind)) / (2 * h)).norm(), kTolerance * product.norm());
  EXPECT_GT(product.norm(), 0);
}

TEST(CandidateLaw, OfAnotherExpansionIsTheSumThatItNames) {
  constexpr double kJ = -0.2, kRounding = 1e-12;
  const VolumeLaw another = other_expansion(0.01);
  EXPECT_NEAR(another(kJ, 2, 1).first + expanded(kJ, 2, 1, kLeastJacobian).first,
              expanded(kJ, 2, 1, 0.01).first, kRounding);
  EXPECT_EQ(another(kLeastJacobian, 2, 1).first, 0);
  // Smith et al. 2018: lambda/2 (J - 1 - mu/lambda)^2, with lambda + mu for lambda to be linear elasticity at rest.
  EXPECT_NEAR(expanded(0.3, 2, 1, 1).first, (2 + 1) * (0.3 - 1) - 1, kRounding);
}

}  // namespace
}  // namespace testbed::massspring
