#include <gtest/gtest.h>

#include "massspring/adapt.h"
#include "meshing/network/build_network.h"
#include "meshing/network/split_in_eight.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface/cut_surface.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

/// A bar that is clamped where x is least and bent by its weight.
Scene bent_bar(int n_vertices) {
  Scene scene;
  scene.surface.shape = "bar";
  scene.surface.n_vertices = n_vertices;
  scene.surface.size = {4, 1, 1};
  scene.material = {1e6, 0.25, 1000, 0};
  scene.gravity = Eigen::Vector3d(0, -1, 0);
  Support clamp;
  clamp.region = {Box{{0, 0, 0}, {0.01, 1, 1}}, true};
  scene.supports = {clamp};
  return scene;
}

/// The same without support, bent by tractions that balance.
Scene freely_bent_bar(int n_vertices) {
  Scene scene = bent_bar(n_vertices);
  scene.gravity.reset();
  scene.supports.clear();
  Load bending;
  bending.stress = {(meshing::StressTerm() << 0, 1, 0, 1e3, 0, 0, 0, 0, 0).finished()};
  scene.loads = {bending};
  return scene;
}

SpringNetwork network_of(const Scene& scene) {
  return build_network(load_surface(scene.surface), scene.network, false, true);
}

/// Displacement of the first n nodes under the full load.
Matrix3Xd displacement_on(const SpringNetwork& network, const Scene& scene, Eigen::Index n) {
  Simulation simulation(scene, network);
  while (!simulation.has_ended()) simulation.advance();
  return simulation.snapshot().u.leftCols(n);
}

/// What the estimate is of, with the finer network solved to the end.
double error_by_finer(const Scene& scene, const SpringNetwork& network, const Matrix3Xd& u) {
  const SpringNetwork finer = split_in_eight(network).network;
  const Eigen::Index n = network.n_surface;
  const Matrix3Xd of_finer = displacement_on(finer, scene, n);
  const Eigen::VectorXd areas = vertex_areas(network.X.leftCols(n), network.F);
  const auto norm = [&](const Matrix3Xd& v) { return std::sqrt(v.colwise().squaredNorm().dot(areas)); };
  return norm(u.leftCols(n) - of_finer) / norm(of_finer) / (1 - static_cast<double>(n) / finer.n_surface);
}

Scene needle(int n_vertices) {
  Scene scene = bent_bar(n_vertices);
  scene.surface.size = {40, 1, 1};
  scene.gravity.reset();
  return scene;
}

void expect_estimate_of_finer_network_solved_to_the_end(const Scene& scene, const SpringNetwork& network) {
  const Matrix3Xd u = displacement_on(network, scene, network.X.cols());
  const double expected = error_by_finer(scene, network, u);
  EXPECT_NEAR(estimate_error(scene, network, u).error, expected, 0.01 * expected);
}

}  // namespace

TEST(ErrorEstimate, OfABentBarIsWithinHalfOfItsDistanceToAFarFinerOne) {
  const Scene scene = bent_bar(120);
  const SurfaceMesh surface = load_surface(scene.surface);
  const SpringNetwork network = network_of(scene);
  const Eigen::Index n = surface.X.cols();
  const Matrix3Xd u = displacement_on(network, scene, network.X.cols());
  const ErrorEstimate estimate = estimate_error(scene, network, u);
  const SurfaceMesh fine = cut_surface(surface, Eigen::VectorXd::Constant(surface.F.cols(), 0.12), 100000);
  ASSERT_GT(fine.X.cols(), 10 * n);
  const Matrix3Xd exact = displacement_on(build_network(fine, scene.network, false, true), scene, n),
                  error = u.leftCols(n) - exact;
  const Eigen::VectorXd areas = vertex_areas(surface.X, surface.F);
  const auto norm = [&](const Matrix3Xd& v) { return std::sqrt(v.colwise().squaredNorm().dot(areas)); };
  const double expected = norm(error) / norm(exact);
  ASSERT_GT(expected, 0.005);
  EXPECT_NEAR(estimate.error, expected, expected / 2);
  ASSERT_EQ(estimate.of_vertex.size(), n);
  EXPECT_NEAR(norm(estimate.of_vertex.transpose().replicate(3, 1) / std::sqrt(3.)), norm(error),
              norm(error) / 2);
}

TEST(ErrorEstimate, IsThatOfTheFinerNetworkSolvedToTheEndToTwoDigits) {
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean}) {
    Scene scene = bent_bar(120);
    scene.material.law = law;
    const SpringNetwork network = network_of(scene);
    const Matrix3Xd u = displacement_on(network, scene, network.X.cols());
    const double expected = error_by_finer(scene, network, u);
    EXPECT_NEAR(estimate_error(scene, network, u).error, expected, 0.03 * expected);
  }
}

// On few nodes above a factor, on more above multigrid.
TEST(ErrorEstimate, IsTheSameWhereTheSolverOfTheNetworkServesTheFinerOne) {
  for (const bool is_held : {true, false}) {
    Scene scene = is_held ? bent_bar(400) : freely_bent_bar(60);
    scene.material.law = MaterialLaw::SmallStrain;
    const SpringNetwork network = network_of(scene);
    Simulation coarse(scene, network);
    coarse.advance();
    const Matrix3Xd u = coarse.snapshot().u;
    const double alone = estimate_error(scene, network, u).error;
    EXPECT_NEAR(estimate_error(scene, network, u, &coarse).error, alone, 0.01 * alone) << is_held;
    const auto [finer, between] = split_in_eight(network);
    Simulation above(scene, finer), own(scene, finer);
    above.set_coarser(between, coarse);
    above.advance();
    own.advance();
    EXPECT_EQ(above.report().solver.rfind("multigrid: above that", 0), 0u) << above.report().solver;
    EXPECT_LT(above.report().linear_iterations, 1.5 * own.report().linear_iterations) << is_held;
    const Matrix3Xd expected = own.snapshot().u;
    EXPECT_LT((above.snapshot().u - expected).norm(), 1e-4 * expected.norm()) << is_held;
  }
}

TEST(ErrorEstimate, TriesNothingElseWhereTheSolverOfTheNetworkDoesNotServe) {
  Scene scene = needle(150);
  scene.surface.size[0] = 160;
  scene.gravity = Eigen::Vector3d(0, -1e-4, 0);
  const SpringNetwork network = network_of(scene);
  Simulation coarse(scene, network), unsolved(scene, network);
  const auto [finer, between] = split_in_eight(network);
  Simulation own(scene, finer), above(scene, finer);
  own.set_coarser(between, unsolved);
  own.advance();
  EXPECT_EQ(own.status(), Status::Ok);
  coarse.advance();
  Eigen::Matrix2Xi nowhere = Eigen::Matrix2Xi::Zero(2, between.cols());  // all as one node, which is clamped
  nowhere.rightCols(1).setConstant(static_cast<int>(network.X.cols()) - 1);
  above.set_coarser(nowhere, coarse);
  above.advance();
  EXPECT_EQ(above.status(), Status::NotConverged);
  EXPECT_LE(above.report().linear_iterations, 200);
}

// The solver of a network whose far end stands still, too, does not serve, and so shows that it is asked.
TEST(ErrorEstimate, AsksTheSolverOfTheNetwork) {
  Scene scene = needle(150), held = scene;
  scene.surface.size[0] = held.surface.size[0] = 160;
  scene.gravity = held.gravity = Eigen::Vector3d(0, -1e-4, 0);
  held.supports[0].region = {Box{{0, 0, 0}, {0.9, 1, 1}}, true};
  const SpringNetwork network = network_of(scene);
  Simulation coarse(scene, network), other(held, network);
  coarse.advance();
  other.advance();
  const Matrix3Xd u = coarse.snapshot().u;
  EXPECT_NO_THROW(estimate_error(scene, network, u, &coarse));
  EXPECT_THROW(estimate_error(scene, network, u, &other), std::runtime_error);
}

TEST(ErrorEstimate, OfANeedleIsThatOfTheFinerNetworkSolvedToTheEnd) {
  Scene scene = needle(900);
  scene.gravity = Eigen::Vector3d(0, -1e-4, 0);
  expect_estimate_of_finer_network_solved_to_the_end(scene, network_of(scene));
}

// Solved as loosely as at small strain, it would leave most of its load out of balance.
TEST(ErrorEstimate, IsThereForANeedleAtFiniteStrain) {
  Scene scene = needle(900);
  scene.material.law = MaterialLaw::NeoHookean;
  scene.gravity = Eigen::Vector3d(0, -6e-3, 0);
  const SpringNetwork network = network_of(scene);
  EXPECT_NO_THROW(estimate_error(scene, network, displacement_on(network, scene, network.X.cols())));
}

TEST(ErrorEstimate, OfACurvedNeedleWhoseEndMovesIsThatOfTheFinerNetworkSolvedToTheEnd) {
  Scene scene = needle(300);
  scene.surface.size[0] = 160;
  SpringNetwork network = network_of(scene);
  const Eigen::Vector3d low = network.X.rowwise().minCoeff();
  const double radius = scene.surface.size[0] / (M_PI / 2);  // of a quarter of a circle, from +x to +y
  for (auto x : network.X.colwise()) {
    const double angle = (x[0] - low[0]) / radius, r = radius - x[1];
    x.head<2>() << r * std::sin(angle), radius - r * std::cos(angle);
  }
  Support moved;
  moved.region = {Box{{0, 0.999, 0}, {1, 1, 1}}, true};
  moved.fixed = {true, true, false};
  moved.displacement = {-5, 0, 0};
  scene.supports.push_back(moved);
  expect_estimate_of_finer_network_solved_to_the_end(scene, network);
}

TEST(ErrorEstimate, OfABallPressedByAPlateIsThatOfTheFinerNetworkSolvedToTheEnd) {
  Scene scene = bent_bar(162);
  scene.surface.shape = "ball";
  scene.surface.size = {2, 2, 2};
  scene.gravity.reset();
  scene.supports[0].region = {Box{{0, 0, 0}, {1, 0.1, 1}}, true};
  scene.obstacles = {{HalfSpace{{0, 1, 0}, {0, -1, 0}}, {{0, 0, 0, 0}, {1, 0, -0.2, 0}}}};
  EXPECT_FALSE(has_friction(scene));
  expect_estimate_of_finer_network_solved_to_the_end(scene, network_of(scene));
  scene.obstacles[0].friction = 0.1;
  EXPECT_TRUE(has_friction(scene));
}

TEST(ErrorEstimate, OfABodyThatFrictionHoldsIsThatOfTheFinerNetworkInAsManySteps) {
  Scene scene = bent_bar(49);
  scene.surface.size = {1, 1, 1};
  scene.gravity.reset();
  scene.supports.clear();
  for (const double y : {0., 1.})
    scene.obstacles.push_back(
        {HalfSpace{{0, y, 0}, {0, 1 - 2 * y, 0}}, {{0, 0, 0, 0}, {1, 0, 0.125 * (1 - 2 * y), 0}}});
  for (Obstacle& plate : scene.obstacles) plate.friction = 0.2;
  scene.material.law = MaterialLaw::NeoHookean;
  scene.time.load_steps = 6;
  const SpringNetwork network = network_of(scene);
  constexpr double kTarget = 0.1;
  const AdaptedSurface adapted = adapt_surface(scene, load_surface(scene.surface), kTarget);
  EXPECT_TRUE(adapted.is_reached);
  const Matrix3Xd u = displacement_on(network, scene, network.X.cols());
  const double expected = error_by_finer(scene, network, u);
  EXPECT_NEAR(adapted.estimate.error, expected, 0.01 * expected);
  EXPECT_EQ(adapted.n_nodes, std::vector<int>{static_cast<int>(network.X.cols())});
  Simulation coarse(scene, network);
  while (!coarse.has_ended()) coarse.advance();
  EXPECT_EQ(estimate_error(scene, network, u, &coarse).error, estimate_error(scene, network, u).error);
}

// They hold it, so that how far it sinks as a whole is part of what the error is over.
TEST(ErrorEstimate, OfABodyThatHandlesHoldCountsRigidMotions) {
  Scene scene = bent_bar(60);
  Handle soft;
  soft.region = scene.supports[0].region;
  soft.stiffness = 1e6;
  scene.handles = {soft};
  scene.supports.clear();
  expect_estimate_of_finer_network_solved_to_the_end(scene, network_of(scene));
}

// How far its weight moves it in the mean is no rigid motion that is free.
TEST(ErrorEstimate, OfABodyThatRollsLeavesOutWhatItsSupportLeavesFreeAlone) {
  Scene scene = bent_bar(60);
  scene.gravity = Eigen::Vector3d(-1, 0, 0);
  scene.supports[0].fixed = {{true, false, false}};
  expect_estimate_of_finer_network_solved_to_the_end(scene, network_of(scene));
}

TEST(ErrorEstimate, OfUniformStretchIsBelowWhatItIsSolvedTo) {
  Scene scene = bent_bar(60);
  scene.gravity.reset();
  scene.supports.clear();
  Load load;
  load.pressure = 1e3;
  scene.loads = {load};
  const SpringNetwork network = network_of(scene);
  const Matrix3Xd u = displacement_on(network, scene, network.X.cols());
  EXPECT_LT(estimate_error(scene, network, u).error, 1e-6);
}

TEST(ErrorEstimate, OfAFreeBodyIsTheSameWhereverItHasGone) {
  const Scene scene = freely_bent_bar(60);
  const SpringNetwork network = network_of(scene);
  const Matrix3Xd u = displacement_on(network, scene, network.X.cols());
  const double error = estimate_error(scene, network, u).error;
  EXPECT_GT(error, 1e-3);
  EXPECT_NEAR(estimate_error(scene, network, u.colwise() + Eigen::Vector3d(1, 2, 3)).error, error,
              1e-3 * error);
}

TEST(ErrorEstimate, OfWhatDoesNotMoveIsRefused) {
  Scene scene = bent_bar(60);
  scene.gravity.reset();
  const SpringNetwork network = network_of(scene);
  EXPECT_THROW(estimate_error(scene, network, Matrix3Xd::Zero(3, network.X.cols())), std::runtime_error);
}

TEST(EdgesOverThickness, AreThoseOfAPlateAndOfABall) {
  SpringNetwork network;
  for (const double thickness : {0.01, 0.002}) {
    // A plate of a square's two triangles on either side.
    network.X = Matrix3Xd(3, 8);
    network.X << 0, 1, 1, 0, 0, 1, 1, 0,  //
        0, 0, 1, 1, 0, 0, 1, 1,           //
        0, 0, 0, 0, thickness, thickness, thickness, thickness;
    network.F = Eigen::Matrix3Xi(3, 12);
    network.F << 0, 0, 4, 4, 0, 0, 1, 1, 2, 2, 3, 3,  //
        2, 3, 5, 6, 1, 5, 2, 6, 3, 7, 0, 4,           //
        1, 2, 6, 7, 5, 4, 6, 5, 7, 6, 4, 7;
    network.n_surface = 8;
    EXPECT_NEAR(edges_over_thickness(network), std::sqrt(2) / thickness, 0.02 * std::sqrt(2) / thickness);
  }
  Scene ball = bent_bar(300);
  ball.surface.shape = "ball";
  EXPECT_LT(edges_over_thickness(network_of(ball)), 2);
}

TEST(ErrorEstimate, OfTooManyNodesIsRefused) {
  Scene scene;
  for (const auto& [law, most] :
       {std::pair(MaterialLaw::SmallStrain, 60000), {MaterialLaw::NeoHookean, 50000}}) {
    scene.material.law = law;
    SpringNetwork network;
    network.X.resize(3, most + 1);
    try {
      estimate_error(scene, network, network.X);
      FAIL();
    } catch (const std::runtime_error& error) {
      EXPECT_EQ(std::string(error.what()).rfind(std::to_string(most + 1) + " nodes, of at most", 0), 0u);
    }
  }
}

TEST(AdaptSurface, EndsWhereTheErrorIsBelowItsTarget) {
  const Scene scene = bent_bar(60);
  const SurfaceMesh surface = load_surface(scene.surface);
  constexpr double kTarget = 0.02;
  const AdaptedSurface adapted = adapt_surface(scene, surface, kTarget);
  ASSERT_TRUE(adapted.is_reached);
  EXPECT_LE(adapted.estimate.error, kTarget);
  EXPECT_EQ(adapted.errors.size(), adapted.n_nodes.size());
  EXPECT_EQ(adapted.errors.back(), adapted.estimate.error);
  EXPECT_GT(adapted.errors.front(), kTarget);
  EXPECT_EQ(adapted.n_nodes.back(), adapted.network.X.cols());
  EXPECT_EQ(adapted.surface.X.leftCols(surface.X.cols()), surface.X);
}

TEST(AdaptSurface, AddsNothingWhereTheFirstEstimateMeetsTheTarget) {
  const Scene scene = bent_bar(60);
  const SurfaceMesh surface = load_surface(scene.surface);
  const AdaptedSurface adapted = adapt_surface(scene, surface, 0.9);
  EXPECT_TRUE(adapted.is_reached);
  EXPECT_EQ(adapted.n_nodes.size(), 1U);
  EXPECT_EQ(adapted.surface.X, surface.X);
}

TEST(AdaptSurface, DoesNotEndWhereSpringsLock) {
  Scene scene = bent_bar(60);
  scene.surface.size = {1, 1, 0.01};
  const SurfaceMesh surface = load_surface(scene.surface);
  EXPECT_GT(edges_over_thickness(network_of(scene)), kTooThin);
  constexpr double kAnyError = 1e3;
  const AdaptedSurface adapted = adapt_surface(scene, surface, kAnyError);
  EXPECT_TRUE(adapted.is_reached);
  EXPECT_GT(adapted.n_nodes.size(), 1u);
  EXPECT_LE(edges_over_thickness(adapted.network), kTooThin);
}

TEST(AdaptSurface, CutsNearTheClampFirst) {
  const Scene scene = bent_bar(500);
  const SurfaceMesh surface = load_surface(scene.surface);
  const double first = adapt_surface(scene, surface, 1).estimate.error;
  const AdaptedSurface adapted = adapt_surface(scene, surface, 0.7 * first);
  const auto near = [](const SurfaceMesh& body, double from, double to) {
    return (body.X.row(0).array() >= from && body.X.row(0).array() < to).count();
  };
  const double x0 = surface.X.row(0).minCoeff();
  const auto growth = [&](double from, double to) {
    return static_cast<double>(near(adapted.surface, x0 + from, x0 + to)) /
           static_cast<double>(near(surface, x0 + from, x0 + to));
  };
  EXPECT_GT(growth(0, 1), 1.5 * growth(3, 4.1));
}

}  // namespace testbed::massspring
