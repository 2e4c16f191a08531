#include <gtest/gtest.h>

#include <cmath>

#include "massspring/model/collapse.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

constexpr double kRounding = 1e-14;

/// The unit tetrahedron; its bounding box measures 1 m a side, so that distances are the normalised ones.
MassSpringModel tetrahedron() {
  MassSpringModel model;
  TetMesh& network = model.network;
  network.X.resize(3, 4);
  network.X << 0, 1, 0, 0,  //
      0, 0, 1, 0,           //
      0, 0, 0, 1;
  network.F.resize(3, 4);
  network.F << 0, 0, 0, 1,  //
      2, 1, 3, 2,           //
      1, 3, 2, 3;
  Eigen::Matrix2Xi E(2, 6);
  E << 0, 0, 0, 1, 1, 2,  //
      1, 2, 3, 2, 3, 3;
  network.T = Eigen::Vector4i(0, 1, 2, 3);
  network.n_surface = 4;
  model.mass = Eigen::VectorXd::Ones(4);
  model.springs = Springs{E, Eigen::VectorXd::Ones(6)};
  model.tet_springs = couple_springs(network.X, network.T, {1, 1}, kEdgeCoupled);
  return model;
}

const Eigen::Vector3d kPivot(0.5, 0, -1);

TEST(Collapse, FallsOffWithTheDistanceFromPivotToSegmentAndToThePatchesCentre) {
  const MassSpringModel model = tetrahedron();
  const Eigen::Matrix3Xd& X = model.network.X;
  const Eigen::Matrix2Xi& E = model.springs->E;
  // From (0.5, 0, -1): 1 to the edge along x, whose middle is nearest; sqrt(1.25) to the one along y, whose
  // end is.
  const Eigen::VectorXd w = fall_off(kPivot, E, X, 1);
  EXPECT_NEAR(w(0), 0.5, kRounding);
  EXPECT_NEAR(w(1), 1 / (1 + std::sqrt(1.25)), kRounding);
  EXPECT_NEAR(fall_off(kPivot, E, X, 2)(0), 1 / 1.5, kRounding) << "not in the box's units";
  const double to_centre = (Eigen::Vector3d::Constant(0.25) - kPivot).norm();
  EXPECT_NEAR(fall_off(kPivot, *model.tet_springs, X, 1)(0), 1 / (1 + to_centre), kRounding);
}

TEST(Collapse, StaticRestLengthsShrinkLinearlyFromThePivotsStart) {
  const MassSpringModel model = tetrahedron();
  const Collapse options{0.4, false, true, 0.05, {{kPivot, {}, 0.5, {}}}};
  State state = initial_state(model);
  const auto length_at = [&](double load_factor) {
    collapse_to(options, model, load_factor, state);
    return state.rest_length(0);
  };
  EXPECT_EQ(length_at(0.5), 1);
  EXPECT_NEAR(length_at(0.75), 1 - 0.4 * 0.5 * 0.5, kRounding);
  EXPECT_NEAR(length_at(1), 1 - 0.4 * 0.5, kRounding);
  const double w = fall_off(kPivot, *model.tet_springs, model.network.X, 1)(0);
  EXPECT_NEAR(state.patch_scale(0), 1 - 0.4 * w, kRounding);
}

TEST(Collapse, DependsOnTheTimeAndNotOnTheStepUnlessAskedTo) {
  const MassSpringModel model = tetrahedron();
  Collapse options{0.4, false, true, 0.05, {{kPivot, {}, 0, {}}}};
  State once = initial_state(model), often = once;
  collapse(options, model, 1, once);
  EXPECT_NEAR(once.rest_length(0), 1 - 0.4 * 0.5, kRounding);
  for (int k = 0; k < 10; ++k) collapse(options, model, 0.1, often);
  EXPECT_LT((once.rest_length - often.rest_length).norm(), kRounding);
  EXPECT_LT((once.patch_scale - often.patch_scale).norm(), kRounding);

  options.is_per_step = true;
  State per_step = initial_state(model);
  for (int k = 0; k < 3; ++k) collapse(options, model, 1e-3, per_step);
  EXPECT_NEAR(per_step.rest_length(0), 0.8 * 0.8 * 0.8, kRounding);
}

TEST(Collapse, FollowsItsPivotWithinItsTimeAndStopsAtTheLeastLength) {
  const MassSpringModel model = tetrahedron();
  Collapse options{0.4, true, true, 0.5, {{kPivot, {{0, 0, 0, 0}, {2, 0, 0, 2}}, 0.5, 1.5}}};
  State state = initial_state(model);
  collapse(options, model, 1, state);
  EXPECT_EQ(state.rest_length(0), 1) << "before its start";
  state.t = 1;  // the pivot is now on the edge
  collapse(options, model, 1, state);
  EXPECT_NEAR(state.rest_length(0), 1 - 0.4, kRounding);
  collapse(options, model, 1, state);
  EXPECT_EQ(state.rest_length(0), 0.5) << "below the least length";
  State ended = initial_state(model);
  ended.t = 1.5;
  collapse(options, model, 1, ended);
  EXPECT_EQ(ended.rest_length(0), 1);
}

const Eigen::VectorXd kEdges = (Eigen::VectorXd(6) << 1, 1, 1, M_SQRT2, M_SQRT2, M_SQRT2).finished();

TEST(Collapse, LeavesEverySpringAndPatchTheLeastPartOfItsOwnLength) {
  const MassSpringModel model = tetrahedron();
  Collapse options{0.9, true, true, 0.8, {{{0.2, 0.2, 0.2}, {}, 0, {}}}};
  State stepped = initial_state(model), fixed = stepped;
  for (int k = 0; k < 5; ++k) collapse(options, model, 1, stepped);
  collapse_to(options, model, 1, fixed);
  for (const State& state : {stepped, fixed}) {
    EXPECT_LT((state.rest_length - 0.8 * kEdges).norm(), kRounding);
    ASSERT_EQ(state.patch_scale.size(), 1);
    EXPECT_EQ(state.patch_scale(0), 0.8);
  }
}

TEST(Collapse, MeasuresDistancesByTheSmallestSideOfTheSurfacesBox) {
  MassSpringModel model = tetrahedron();
  model.network.X = Eigen::Vector3d(3, 2, 5).asDiagonal() * model.network.X;
  Collapse options{0.4, true, true, 0.05, {{{1, 0, -4}, {}, 0, {}}}};  // 4 from the edge along x
  State state = initial_state(model);
  collapse(options, model, 1, state);
  EXPECT_NEAR(state.rest_length(0), 3 * (1 - 0.4 / (1 + 4. / 2)), kRounding);
  const double to_centre = Eigen::Vector3d(1 - 0.75, 0.5, 4 + 1.25).norm();
  EXPECT_NEAR(state.patch_scale(0), 1 - 0.4 / (1 + to_centre / 2), kRounding);
}

TEST(Collapse, CanLeaveTheSurfaceItsLengths) {
  const MassSpringModel model = small_model();  // a tetrahedron's edges, then four springs to a node inside
  Collapse options{0.4, true, false, 0.05, {{{0.5, 0, -1}, {}, 0, {}}}};
  State state = initial_state(model);
  const Eigen::VectorXd before = state.rest_length;
  collapse(options, model, 1, state);
  EXPECT_EQ(state.rest_length.head(6), before.head(6));
  EXPECT_LT((state.rest_length.tail(4) - before.tail(4)).maxCoeff(), -0.01);
}

// The node inside a box of two tetrahedra a side lies 0.5 m below its surface, all others on it.
TEST(Collapse, OfCoupledSpringsFadesTowardsASurfaceThatKeepsItsLengths) {
  MassSpringModel model;
  model.network = box_tets(2, 2, 2, 0.5);
  const Eigen::Matrix3Xd& X = model.network.X;
  model.network.n_surface = static_cast<int>(X.cols());
  model.tet_springs = couple_springs(X, model.network.T, {1, 1}, kEdgeCoupled);
  Collapse options{0.4, true, false, 0.05, {{{0.5, 0.5, 0.5}, {}, 0, {}}}, 0.8};
  State even = initial_state(model), faded = even;
  collapse(options, model, 1, even);
  model.collapsing = collapsing_patches(options, model);
  collapse(options, model, 1, faded);
  int n_inside = 0;
  for (int p = 0; p < model.tet_springs->n_patches(); ++p) {
    double inside = 0;  // of the patch's four nodes
    for (int e = model.tet_springs->first[p]; e < model.tet_springs->first[p + 1]; ++e)
      inside += (X.col(model.tet_springs->node[e]) - Eigen::Vector3d::Constant(0.5)).norm() < 1e-9;
    n_inside += inside > 0;
    EXPECT_NEAR(1 - faded.patch_scale(p), inside / 4 * 0.5 / 0.8 * (1 - even.patch_scale(p)), kRounding);
  }
  EXPECT_GT(n_inside, 0);
}

TEST(Collapse, OfAStaticSceneEndsWithItsPivotWhereThatIs) {
  const MassSpringModel model = tetrahedron();
  const Collapse options{0.4, false, true, 0.05, {{{0.5, 0, -1}, {{0, 0, 0, 0}, {1, 0, 0, 2}}, 0.25, 0.5}}};
  for (const double load_factor : {0.5, 1.}) {
    State state = initial_state(model);
    collapse_to(options, model, load_factor, state);
    EXPECT_NEAR(state.rest_length(0), 1 - 0.4 / 3, kRounding) << load_factor;
  }
}

TEST(Collapse, UniformShrinkageOfCoupledSpringsIsFreeOfForces) {
  const TetMesh mesh = box_tets(2, 2, 2, 0.5, 0.15);
  const TetSprings springs = couple_springs(mesh.X, mesh.T, {2, 1}, kNodeAveraged);
  const Eigen::VectorXd scale = Eigen::VectorXd::Constant(springs.n_patches(), 0.7);
  Eigen::Matrix3Xd f = Eigen::Matrix3Xd::Zero(3, mesh.X.cols());
  add_forces(springs, -0.3 * mesh.X, f, scale);
  EXPECT_LT(f.norm(), 1e-13);
  add_forces(springs, 0 * mesh.X, f, scale);
  EXPECT_GT(f.norm(), 0.1);
}

TEST(Relaxation, LeavesAnUnbentSurfaceAsItIs) {
  MassSpringModel model = tetrahedron();
  model.bending = make_bending(model.network.X, model.network.F, 1);
  State state = initial_state(model);
  relax_surface(0.5, model, 1, state);
  EXPECT_EQ(state.rest_length, initial_state(model).rest_length);
}

// Two edges are bent. About that along x the triangles press with a force of sqrt(2) on node 0, right above
// which both third corners stand, and none on node 1. About the one from 2 to 3 they press with 1/sqrt(3) on
// both ends, times sqrt(3/2): half as much.
TEST(Relaxation, ShortensEdgesByTheShareOfTheLargestBendingForceAtTheirEnds) {
  MassSpringModel model = tetrahedron();
  Bending bending;
  bending.hinges.resize(4, 2);
  bending.hinges << 0, 2, 1, 3, 3, 1, 2, 0;
  bending.area.setConstant(2, 2, 0.5);
  bending.area(0, 1) = std::sqrt(0.75);
  constexpr double kBent = 0.01;
  bending.rest_angle = Eigen::Vector2d(M_PI / 2 - kBent, std::acos(-1 / std::sqrt(3.)) + kBent);
  bending.stiffness = Eigen::Vector2d(1, std::sqrt(1.5));
  model.bending = bending;
  State state = initial_state(model);
  constexpr double kCoefficient = 0.5, kSeconds = 2;
  relax_surface(kCoefficient, model, kSeconds, state);
  const Eigen::Vector4d share(1, 0, 0.5, 0.5);
  const Eigen::Matrix2Xi& E = model.springs->E;
  for (int s = 0; s < 6; ++s) {
    const double mean = (share(E(0, s)) + share(E(1, s))) / 2;
    EXPECT_NEAR(state.rest_length(s), kEdges(s) * std::pow(1 - kCoefficient * mean, kSeconds), 1e-12) << s;
  }
}

}  // namespace
}  // namespace testbed::massspring
