// A body whose fibres collapse in motion: against closed forms, differences, halved steps and a run that goes on.
#include <gtest/gtest.h>

#include <cmath>

#include "fem_reference/solid/simulation.h"
#include "meshing/scene/collapse.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kFar = 1e7;  // m: from there a body collapses evenly

/// A box of 1 m x 1 m x 1 m that nothing holds, so stiff that it follows its collapse.
struct CollapsingBox {
  TetMesh mesh = box_tets(2, 2, 2, 0.5);
  Scene scene;
  StageTimer timer;
  CollapsingBox() {
    scene.material = {1e7, 0.3, 1000, 0};
    scene.reference.integrator = "minimising_euler";
    scene.time.mode = TimeMode::Dynamic;
    scene.time.end = 1;
    scene.time.step = 0.05;
    Collapse& collapse = scene.collapse.emplace();
    collapse.coefficient = 0.3;
    collapse.pivots = {{Vector3d(1.2, 0.3, 0.4), {}, 0, {}}};
  }
  /// Every point is depleted by a part of its length.
  void make_even(double part) {
    scene.collapse->coefficient = part * kFar;  // eq. 8 divides by 1 + distance over the smallest side, 1 m
    scene.collapse->pivots = {{Vector3d(kFar, 0, 0), {}, 0, {}}};
  }
  Simulation simulation() { return {scene, {mesh.X, mesh.F}, mesh, timer}; }
};

Simulation& to_end(Simulation& simulation) {
  while (!simulation.has_ended()) simulation.advance();
  EXPECT_EQ(simulation.status(), Status::Ok);
  return simulation;
}

/// Distance of two nodes that lie across the body.
double width(const Simulation& simulation) {
  const Matrix3Xd x = simulation.X() + simulation.snapshot().u;
  return (x.col(x.cols() > 27 ? 26 : x.cols() - 1) - x.col(0)).norm() / std::sqrt(3.);
}

TEST(CollapseInMotion, ShortensAFreeBodyByItsPartASecondDownToTheLeast) {
  constexpr double kPart = 0.3, kLeast = 0.2, kEven = 1e-6;
  for (const int degree : {1, 2}) {
    CollapsingBox box;
    box.make_even(kPart);
    box.scene.skin.emplace().stiffness = 1e6;  // it shortens as the body does
    box.scene.reference.degree = degree;
    box.scene.collapse->least = kLeast;
    Simulation second = box.simulation();
    const VectorXd length = to_end(second).state().length;
    EXPECT_LT((length.array() - (1 - kPart)).abs().maxCoeff(), kEven);
    EXPECT_NEAR(width(second), 1 - kPart, 1e-3);  // less what inertia keeps it behind
    box.scene.time.end = 8;                       // 0.7^4.5 is the least
    Simulation last = box.simulation();
    EXPECT_EQ(to_end(last).state().length.maxCoeff(), kLeast);
    EXPECT_NEAR(width(last), kLeast, 1e-6);
    EXPECT_LT(last.snapshot().elastic_energy, 1e-9 * box.scene.material.E) << "stress-free";
  }
}

TEST(CollapseInMotion, DependsOnTheTimeAndNotOnTheStepUnlessAskedTo) {
  constexpr double kPart = 0.3;
  CollapsingBox box;
  box.make_even(kPart);
  box.scene.time.end = 0.1;  // two steps
  Simulation by_time = box.simulation();
  EXPECT_NEAR(to_end(by_time).state().length(0), std::pow(1 - kPart, 0.1), 1e-6);
  box.scene.collapse->is_per_step = true;
  Simulation by_step = box.simulation();
  EXPECT_NEAR(to_end(by_step).state().length(0), std::pow(1 - kPart, 2), 1e-6);
}

TEST(CollapseInMotion, FollowsItsPivotWithinItsTime) {
  Collapse collapse;
  collapse.coefficient = 0.4;
  collapse.is_per_step = true;
  collapse.pivots = {{Vector3d(0, 0, -1), {{0, 0, 0, 0}, {2, 0, 0, 2}}, 0.5, 1.5}};
  const Matrix3Xd x = Matrix3Xd::Zero(3, 2);
  const VectorXd part = Eigen::Vector2d(1, 0.5);
  const auto after = [&](double t) {
    VectorXd length = VectorXd::Ones(2);
    collapse_in_step(collapse, 2, part, x, t, 0.01, length);
    return length;
  };
  for (const double idle : {0.4, 1.5}) EXPECT_EQ(after(idle), VectorXd::Ones(2)) << idle;
  EXPECT_LT((after(1) - Eigen::Vector2d(0.6, 0.8)).norm(), 1e-14) << "the pivot is there";
  EXPECT_NEAR(after(0.5)(0), 1 - 0.4 / (1 + 0.5 / 2), 1e-14);
}

/// A body that flies past its pivot, at 10 m/s, is most depleted near it.
TEST(CollapseInMotion, IsAroundWhereTheBodyIs) {
  constexpr double kFlown = 10, kPart = 0.3, kDifference = 0.03;
  CollapsingBox box;
  box.scene.time.step = 0.01;
  box.scene.collapse->coefficient = kPart;
  box.scene.collapse->pivots[0].point = Vector3d(kFlown, 0.5, 0.5);
  box.scene.initial.emplace_back().velocity = Vector3d(kFlown, 0, 0);
  Simulation simulation = box.simulation();
  double logarithm = 0;  // of what is left at the first node, were it not drawn inwards
  for (int n = 0; n < 100; ++n)
    logarithm += 0.01 * std::log(1 - kPart / (1 + Vector3d(kFlown * (1 - 0.01 * n), 0.5, 0.5).norm()));
  const double at_rest = std::log(1 - kPart / (1 + Vector3d(kFlown, 0.5, 0.5).norm()));
  EXPECT_NEAR(std::log(to_end(simulation).state().length(0)), logarithm, kDifference * std::abs(logarithm));
  EXPECT_LT(logarithm, 2 * at_rest);
}

TEST(CollapseInMotion, IsAroundItsPivotThoughSupportsAreOblique) {
  CollapsingBox box;
  box.scene.time.step = box.scene.time.end = 0.05;
  box.scene.supports.resize(1);
  box.scene.supports[0].region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  box.scene.supports[0].normal = Vector3d(1, 2, 0);
  Simulation simulation = box.simulation();
  const VectorXd length = to_end(simulation).state().length;
  for (Eigen::Index i = 0; i < length.size(); ++i) {
    const double distance = (box.mesh.X.col(i) - box.scene.collapse->pivots[0].point).norm();
    EXPECT_NEAR(length(i), std::pow(1 - 0.3 / (1 + distance), 0.05), 1e-12) << i;
  }
}

TEST(CollapseInMotion, HasAHistoryOfFirstOrderInTheStep) {
  CollapsingBox box;
  box.scene.reference.degree = 1;
  box.scene.collapse->coefficient = 0.6;
  box.scene.collapse->pivots[0].motion = {{0, 0, 0, 0}, {1, -1.5, 0.4, 0}};
  VectorXd length[3], u[3];
  for (const int k : {0, 1, 2}) {
    box.scene.time.step = 0.05 / (1 << k);
    Simulation simulation = box.simulation();
    length[k] = to_end(simulation).state().length;
    const Matrix3Xd x = simulation.X() + simulation.snapshot().u;
    u[k] = (x.colwise() - x.col(0)).colwise().norm();  // as the body may turn
  }
  EXPECT_GT((length[0] - length[1]).norm(), 1e-4);
  EXPECT_NEAR((length[0] - length[1]).norm() / (length[1] - length[2]).norm(), 2, 0.3);
  EXPECT_NEAR((u[0] - u[1]).norm() / (u[1] - u[2]).norm(), 2, 0.5);
}

TEST(CollapseInMotion, GoesOnFromAStateAsIfNothingHadStopped) {
  for (const Scheme& scheme : schemes()) {
    CollapsingBox box;
    box.scene.reference.integrator = scheme.name;
    box.scene.material.E = 1e5;
    box.scene.time.step = 1e-3;
    box.scene.collapse->coefficient = 0.9;
    Simulation whole = box.simulation(), again = box.simulation();
    const auto take = [](int n, Simulation& simulation) {
      for (int k = 0; k < n; ++k) ASSERT_EQ(simulation.advance(), Status::Ok);
    };
    take(20, whole);
    const State middle = whole.state();
    take(10, whole);
    again.set_state(middle);
    take(10, again);
    const Matrix3Xd u = whole.snapshot().u;
    EXPECT_LE((again.snapshot().u - u).norm(), 1e-8 * u.norm()) << scheme.name;
    EXPECT_LT((again.state().length - whole.state().length).norm(), 1e-10) << scheme.name;
    State forgetful = middle;
    forgetful.length.setOnes();
    again.set_state(forgetful);
    take(10, again);
    EXPECT_GT((again.snapshot().u - u).norm(), 1e-3 * u.norm()) << scheme.name << ": lengths decide";
  }
}

// Boxes of two tetrahedra a side have one node inside, 0.5 m below the surface.
TEST(CollapseInMotion, FadesTowardsASurfaceThatKeepsItsLengths) {
  constexpr double kPart = 0.3, kDepth = 0.8;
  CollapsingBox box;
  box.make_even(kPart);
  box.scene.collapse->surface = false;
  box.scene.collapse->depth = kDepth;
  Simulation simulation = box.simulation();
  const VectorXd length = to_end(simulation).state().length;
  int n_inside = 0;
  for (int i = 0; i < length.size(); ++i) {
    const bool is_inside = (box.mesh.X.col(i) - Vector3d::Constant(0.5)).norm() < 1e-9;
    n_inside += is_inside;
    EXPECT_NEAR(length(i), is_inside ? 1 - kPart * 0.5 / kDepth : 1, 1e-6);
  }
  EXPECT_EQ(n_inside, 1);
}

const Vector3d kSlope(2e-3, -1e-3, 3e-3);  // 1/m

/// At small strain a linear shrinkage is compatible: u_i = -(a . x) x_i + a_i |x|^2 / 2 for s = a . x.
TEST(ShrinkageOfVertices, ThatIsLinearBendsAFreeBodyWithoutStress) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.1);
  ElasticSolid solid(mesh, 2);
  solid.assemble({1e6, 0.3, 1000, 0}, ElasticLaw::SmallStrain, {}, {});
  solid.set_shrinkage(mesh.X.transpose() * kSlope);
  Matrix3Xd exact(3, solid.X().cols());
  for (int i = 0; i < exact.cols(); ++i) {
    const Vector3d x = solid.X().col(i);
    exact.col(i) = -kSlope.dot(x) * x + kSlope * x.squaredNorm() / 2;
  }
  Matrix3Xd force, unshrunk;
  solid.find_forces(exact, 1, force);
  solid.find_forces(0 * exact, 1, unshrunk);
  EXPECT_GT(unshrunk.norm(), 100);  // N
  EXPECT_LT(force.norm(), 1e-11 * unshrunk.norm());
  EXPECT_LT(solid.energy(exact), 1e-18 * solid.energy(0 * exact) + 1e-12);
}

TEST(ShrinkageOfVertices, GivesForcesThatAreTheGradientOfTheEnergyAndATangentThatIsTheirs) {
  constexpr double kStep = 1e-5;
  for (const int degree : {1, 2}) {
    const TetMesh mesh = box_tets(2, 2, 1, 0.5, 0.1);
    ElasticSolid solid(mesh, degree);
    solid.assemble({1e4, 0.3, 1000, 0}, ElasticLaw::NeoHookean, {}, {});
    std::srand(3);
    const VectorXd s = 0.2 + 0.15 * VectorXd::Random(mesh.X.cols()).array();
    const Matrix3Xd u = 0.03 * Matrix3Xd::Random(3, solid.X().cols());
    const Matrix3Xd d = Matrix3Xd::Random(3, u.cols());
    solid.set_shrinkage(s);
    const Linearisation at = solid.linearise(u);
    const double slope = (solid.energy(u + kStep * d) - solid.energy(u - kStep * d)) / (2 * kStep);
    EXPECT_GT(std::abs(slope), 1);  // N
    EXPECT_NEAR(at.force.dot(d.reshaped()), slope, 1e-6 * std::abs(slope)) << degree;
    Matrix3Xd after, before;
    solid.find_forces(u + kStep * d, 1, after);
    solid.find_forces(u - kStep * d, 1, before);
    const VectorXd bent = ((after - before) / (2 * kStep)).reshaped();
    EXPECT_LT((at.tangent * d.reshaped() - bent).norm(), 1e-5 * bent.norm()) << degree;
  }
}

TEST(StaticCollapse, FollowsAPivotToItsEndAndStopsAtTheLeast) {
  Collapse collapse;
  collapse.coefficient = 0.4;
  collapse.pivots = {{Vector3d(0, 0, -1), {{0, 0, 0, 0}, {1, 0, 0, 2}}, 0.25, 0.5}};
  const auto length_at = [&](double load_factor, double part = 1) {
    return static_length(collapse, 2, part, Vector3d::Zero(), load_factor);
  };
  EXPECT_EQ(length_at(0.25), 1);
  EXPECT_NEAR(length_at(0.375), 1 - 0.4 / 6 / (1 + 0.25 / 2), 1e-14);
  for (const double ended : {0.5, 1.}) EXPECT_NEAR(length_at(ended), 1 - 0.4 / 3, 1e-14);
  EXPECT_NEAR(length_at(1, 0.5), 1 - 0.2 / 3, 1e-14);
  collapse.least = 0.95;
  EXPECT_EQ(length_at(1), 0.95);
}

}  // namespace
}  // namespace testbed::fem
