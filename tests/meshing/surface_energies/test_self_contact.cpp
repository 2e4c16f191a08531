#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "massspring/time/integrators.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "meshing/surface_energies/self_contact.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Matrix3Xi;
using Eigen::Vector3d;

/// Two balls beside each other, slightly off the axis.
MassSpringModel two_balls(double gap) {
  const SurfaceMesh ball = make_shape("ball", 42);
  const int n = static_cast<int>(ball.X.cols());
  const double radius = ball.X.colwise().norm().maxCoeff();
  MassSpringModel model;
  model.network.X.resize(3, 2 * n);
  model.network.X << ball.X, ball.X.colwise() + Vector3d(2 * radius + gap, 0.05, 0.03);
  model.network.F.resize(3, 2 * ball.F.cols());
  model.network.F << ball.F, ball.F.array() + n;
  model.network.n_surface = 2 * n;
  model.material.E = 1e3;
  model.mass = Eigen::VectorXd::Ones(2 * n);
  return model;
}

using Nodes = std::array<int, 4>;

SurfaceContact contact_of(const MassSpringModel& model, double thickness) {
  return {model.network.X, model.network.F, model.material.E, thickness};
}

std::vector<NearPair> touching(const SurfaceContact& contact, const Matrix3Xd& x) {
  SurfaceHessian H;
  contact.add_hessian(x, H, Curvature::Projected);
  return H.pairs;
}

/// Least value of a convex function on [0, 1], to 1e-9 times its slope.
template <class Function>
double least(const Function& f) {
  double low = 0, high = 1;
  while (high - low > 1e-9) {
    const double left = low + (high - low) / 3, right = high - (high - low) / 3;
    if (f(left) < f(right))
      high = right;
    else
      low = left;
  }
  return f(low);
}

/// Distance of edges 0-1 and 2-3, or of vertex 0 and triangle 1-2-3, by a search over all their points.
double distance(const Matrix3Xd& x, bool is_edges, const Nodes& node) {
  const Vector3d a = x.col(node[0]), b = x.col(node[1]), c = x.col(node[2]), d = x.col(node[3]);
  return least([&](double s) {
    return least([&](double t) {
      return is_edges ? (a + s * (b - a) - c - t * (d - c)).norm()
                      : (b + s * (c - b) + (1 - s) * t * (d - b) - a).norm();
    });
  });
}

/// All edges with edges and vertices with triangles, one of the first half of the nodes and one of the
/// second, that are closer than `reach`: by their sorted nodes, with their distances.
std::map<Nodes, double> near_pairs(const Matrix3Xi& F, const Matrix3Xd& x, double reach) {
  const int half = static_cast<int>(x.cols()) / 2;
  std::map<Nodes, double> found;
  const auto add = [&](bool is_edges, Nodes node) {
    const int m = is_edges ? 2 : 1;  // nodes of the first part
    Eigen::AlignedBox3d boxes[2];
    for (int k = 0; k < 4; ++k) boxes[k < m ? 0 : 1].extend(x.col(node[k]));
    if ((node[0] < half) == (node[m] < half) || boxes[0].exteriorDistance(boxes[1]) > reach) return;
    const double d = distance(x, is_edges, node);
    std::sort(node.begin(), node.end());
    if (d < reach) found[node] = d;
  };
  for (const auto& t : F.colwise()) {
    for (int v = 0; v < 2 * half; ++v) add(false, {v, t(0), t(1), t(2)});
    for (const auto& s : F.colwise())
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l) add(true, {t(k), t((k + 1) % 3), s(l), s((l + 1) % 3)});
  }
  return found;
}

/// The same of the pairs that are in touch, by their weights.
std::map<Nodes, double> touching_pairs(const SurfaceContact& contact, const Matrix3Xd& x) {
  std::map<Nodes, double> found;
  for (const NearPair& pair : touching(contact, x)) {
    Vector3d e = Vector3d::Zero();
    for (int k = 0; k < 4; ++k) e += pair.weight[k] * x.col(pair.node[k]);
    Nodes node = pair.node;
    std::sort(node.begin(), node.end());
    EXPECT_EQ(found.count(node), 0u) << "twice in the list";
    found[node] = e.norm();
  }
  return found;
}

/// Pairs of `found` and `expected` and their distances are the same.
void expect_same(const std::map<Nodes, double>& found, const std::map<Nodes, double>& expected) {
  constexpr double kSearched = 1e-8;  // m, how well the search finds a distance
  EXPECT_EQ(found.size(), expected.size());
  for (const auto& [node, d] : expected) {
    ASSERT_EQ(found.count(node), 1u) << node[0] << ' ' << node[1] << ' ' << node[2] << ' ' << node[3];
    EXPECT_NEAR(found.at(node), d, kSearched);
  }
}

class TwoBalls : public testing::Test {
 protected:
  const double thickness = 0.05;
  const MassSpringModel model = two_balls(0.3);
  const int n = model.network.n_surface / 2;
  SurfaceContact contact = contact_of(model, thickness);

  Matrix3Xd moved(double by) const {
    Matrix3Xd x = model.network.X;
    x.rightCols(n).row(0).array() -= by;
    return x;
  }
  Matrix3Xd forces(const Matrix3Xd& x) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, x.cols());
    contact.add_forces(x, f);
    return f;
  }
};

TEST_F(TwoBalls, PushEachOtherApartAlsoWhereTheyHavePassedThrough) {
  contact.begin_step(0, 1, model.network.X);
  EXPECT_EQ(forces(model.network.X).norm(), 0) << "apart";
  for (double by = 0; by < 0.32; by += 0.02) contact.begin_step(0, 1, moved(by));
  for (const double by : {0.33, 0.36, 0.4, 0.45}) {
    const Matrix3Xd f = forces(moved(by));
    EXPECT_GT(f.rightCols(n).row(0).sum(), 1) << by;
    EXPECT_LT(f.leftCols(n).row(0).sum(), -1) << by;
  }
}

TEST_F(TwoBalls, ThatHavePassedThroughKeepTheirSidesWhenTheyMoveOnAndPairsAreListedAnew) {
  for (double by = 0; by < 0.41; by += 0.02) contact.begin_step(0, 1, moved(by));
  const Matrix3Xd x = moved(0.4), before = forces(x), on = x.colwise() + Vector3d(0, 0.5, 0.3);
  EXPECT_GT(before.rightCols(n).row(0).sum(), 1);
  contact.begin_step(0, 1, on);
  EXPECT_LT((forces(on) - before).norm(), 1e-10 * before.norm());
}

TEST_F(TwoBalls, GoOnFromWhatOthersRememberOfThem) {
  for (double by = 0; by < 0.41; by += 0.02) contact.begin_step(0, 1, moved(by));
  const Matrix3Xd x = moved(0.4);
  const auto of_step_at_x = [&](const SurfaceEnergies& energies) {
    energies[0]->begin_step(0, 1, x);
    Matrix3Xd f = Matrix3Xd::Zero(3, x.cols());
    energies[0]->add_forces(x, f);
    return f;
  };
  const SurfaceEnergies known{std::make_shared<SurfaceContact>(contact)},
      taught{std::make_shared<SurfaceContact>(contact_of(model, thickness))},
      fresh{std::make_shared<SurfaceContact>(contact_of(model, thickness))};
  remember(memories_of(known), taught);
  const Matrix3Xd expected = of_step_at_x(known);
  EXPECT_EQ(of_step_at_x(taught), expected);
  EXPECT_GT((of_step_at_x(fresh) - expected).norm(), 0.1 * expected.norm()) << "passed unseen";
}

TEST_F(TwoBalls, ForceIsMinusEnergyGradientAndKeepsMomentum) {
  for (double by = 0; by < 0.34; by += 0.02) contact.begin_step(0, 1, moved(by));
  const Matrix3Xd x = moved(0.34) + random_points(2 * n, 2e-3, 7), f = forces(x);
  ASSERT_GT(f.norm(), 1);
  constexpr double kStep = 1e-7;
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x;
    up(k) += kStep;
    down(k) -= kStep;
    EXPECT_NEAR(f(k), -(contact.energy(up) - contact.energy(down)) / (2 * kStep), 1e-5 * f.norm());
  }
  Vector3d torque = Vector3d::Zero();
  for (int i = 0; i < x.cols(); ++i) torque += x.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), 1e-12 * f.norm());
  EXPECT_LT(torque.norm(), 1e-12 * f.norm());
}

TEST_F(TwoBalls, PotentialOfAMotionHasAllItsUndampedForcesAsNegativeGradient) {
  Forces all = no_forces(model);
  all.load = random_points(2 * n, 3, 8);
  add_volume_penalty(20, model, all);
  all.surface.push_back(std::make_shared<FollowerPressure>(4, Faces{model.network.F}));
  const Contacts contacts{{}, thickness};
  EquationOfMotion motion(model, all, contacts);
  for (double by = 0; by < 0.34; by += 0.02) motion.touching[0]->begin_step(0, 1, moved(by));
  State state = initial_state(model);
  state.x = moved(0.34);
  Matrix3Xd f;
  motion.undamped_forces_at(state, f);
  Matrix3Xd by_contact = Matrix3Xd::Zero(3, 2 * n);
  motion.touching[0]->add_forces(state.x, by_contact);
  ASSERT_GT(by_contact.norm(), 0.1 * f.norm());
  constexpr double kStep = 1e-7;
  for (int k = 0; k < f.size(); ++k) {
    State up = state, down = state;
    up.x(k) += kStep;
    down.x(k) -= kStep;
    EXPECT_NEAR(f(k), -(motion.potential(up) - motion.potential(down)) / (2 * kStep), 1e-5 * f.norm());
  }
}

TEST(SurfaceContact, NearestPointsOfTwoTrianglesAreThoseOfABruteForceSearch) {
  constexpr double kThickness = 0.3, kFar = 100;
  MassSpringModel model = crossing_triangles(0, kFar);
  for (int trial = 0; trial < 150; ++trial) {
    const Matrix3Xd x = random_points(6, 0.7, trial);
    SurfaceContact contact = contact_of(model, kThickness);  // that has seen no earlier side of them
    contact.begin_step(0, 1, x);
    expect_same(touching_pairs(contact, x), near_pairs(model.network.F, x, kThickness));
  }
}

TEST_F(TwoBalls, PairsAreThoseOfABruteForceSearchAlsoAfterMovesPastTheMargin) {
  const double gap = 0.55;  // beyond reach, which is the thickness and half a mean edge of 0.59
  const MassSpringModel apart = two_balls(gap);
  SurfaceContact moving = contact_of(apart, thickness);
  Matrix3Xd x = apart.network.X;
  const auto advance = [&](double by) {
    x.leftCols(n).row(0).array() += by / 2;
    x.rightCols(n).row(0).array() -= by / 2;
    moving.begin_step(0, 1, x);
  };
  advance(0);
  EXPECT_TRUE(touching(moving, x).empty());
  for (int i = 0; i < 20; ++i) advance((gap - 0.01) / 20);
  const std::map<Nodes, double> expected = near_pairs(apart.network.F, x, thickness);
  int n_edges = 0;
  for (const auto& [node, d] : expected) n_edges += node[1] < n && node[2] >= n;
  EXPECT_GT(n_edges, 0);
  EXPECT_GT(static_cast<int>(expected.size()), n_edges);
  expect_same(touching_pairs(moving, x), expected);
}

TEST_F(TwoBalls, AThinGapAtRestGivesNoForceAndPairsFartherApartDo) {
  const MassSpringModel close = two_balls(0.03);
  SurfaceContact resting = contact_of(close, thickness);
  resting.begin_step(0, 1, close.network.X);
  ASSERT_FALSE(near_pairs(close.network.F, close.network.X, thickness).empty());
  Matrix3Xd f = Matrix3Xd::Zero(3, 2 * n);
  resting.add_forces(close.network.X, f);
  EXPECT_EQ(f.norm(), 0);
  EXPECT_EQ(resting.energy(close.network.X), 0);
  // Away, and back with another side in front: the same gap between parts that were far from each other.
  Matrix3Xd x = close.network.X;
  x.rightCols(n).row(0).array() += 1;
  resting.begin_step(0, 1, x);
  const Vector3d centre = close.network.X.rightCols(n).rowwise().mean();
  x.rightCols(n) =
      (Vector3d(-1, -1, 1).asDiagonal() * (close.network.X.rightCols(n).colwise() - centre)).colwise() +
      centre;
  resting.begin_step(0, 1, x);
  const std::map<Nodes, double> expected = near_pairs(close.network.F, x, thickness);
  EXPECT_FALSE(expected.empty());
  expect_same(touching_pairs(resting, x), expected);
}

// Moved along their common normal, edges that cross keep their nearest points, so that energy and force are
// those of a spring. The second angle's sine is below a tenth, where parallel edges begin to be smoothed
// away.
TEST(SurfaceContact, StiffnessIsTheSlopeOfTheForceAlsoOfNearlyParallelEdges) {
  constexpr double kThickness = 0.05, kStep = 1e-3;
  for (const double angle : {1.0, 0.07}) {
    const MassSpringModel model = crossing_triangles(angle, 2);
    SurfaceContact contact = contact_of(model, kThickness);
    const auto at = [&](double gap) {
      Matrix3Xd x = model.network.X;
      x.leftCols(3).row(2).array() += gap - 2;
      return x;
    };
    const auto lift = [&](double gap) {
      Matrix3Xd f = Matrix3Xd::Zero(3, 6);
      contact.add_forces(at(gap), f);
      return f.leftCols(3).row(2).sum();
    };
    contact.begin_step(0, 1, at(0.04));
    const std::vector<NearPair> pairs = touching(contact, at(0.04));
    ASSERT_EQ(pairs.size(), 1u) << angle;
    const double slope = (lift(0.04 - kStep) - lift(0.04 + kStep)) / (2 * kStep);
    EXPECT_NEAR(pairs[0].stiffness, slope, 1e-9 * slope) << angle;  // the force is linear
    double mean_edge = 0;
    for (const auto& e : model.springs->E.colwise())
      mean_edge += (model.network.X.col(e(0)) - model.network.X.col(e(1))).norm() / 6;
    // 2 q - q^2 of the squared sine q over its bound of 0.01
    const double share = angle > 0.1 ? 1 : 100 * std::pow(std::sin(angle), 2);
    EXPECT_NEAR(slope, share * (2 - share) * 1e3 * mean_edge, 1e-6 * slope) << angle;
  }
}

TEST_F(TwoBalls, BounceInsteadOfPassingThrough) {
  const std::map<std::string, double> steps{
      {"symplectic_euler", 2e-3}, {"implicit_euler", 2e-3}, {"minimising_euler", 5e-3}};
  for (const auto& [integrator, h] : steps) {
    MassSpringModel body = model;
    Eigen::Matrix2Xi pairs(2, 2 * n * (n - 1) / 2);
    int s = 0;
    for (int ball = 0; ball < 2; ++ball)
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < i; ++j) pairs.col(s++) << ball * n + i, ball * n + j;
    body.springs = Springs{pairs, Eigen::VectorXd::Constant(s, 200.0)};
    body.mass.setConstant(0.02);  // light enough for the penalty to stop it within the thickness
    const Forces forces = no_forces(body);
    const Contacts contacts{{}, thickness};
    State state = initial_state(body);
    state.v.rightCols(n).row(0).setConstant(-1);
    TimeStepper stepper(body, forces, integrator, 2, {}, contacts);
    while (state.t < 2) ASSERT_EQ(stepper.step(state, h).status, Status::Ok);
    const double left = state.x.leftCols(n).row(0).mean(), right = state.x.rightCols(n).row(0).mean();
    EXPECT_GT(right - left, 2) << "passed through";
    EXPECT_LT(state.v.leftCols(n).row(0).mean(), -0.3) << "momentum not handed on";
    EXPECT_NEAR(state.v.row(0).mean(), -0.5, 1e-6) << "momentum not kept";
  }
}

TEST(ContactsOf, SurfaceKeepsAFifthOfItsMeanEdgeFromItselfUnlessToldHowMuch) {
  const TetMesh box = box_tets(1, 2, 3, 1);
  const SurfaceMesh surface{box.X, box.F};
  Scene scene;
  EXPECT_FALSE(contacts_of(scene, surface).self_thickness);
  scene.self_contact.is_on = true;
  // 22 squares of two triangles: 44 sides, and 22 diagonals.
  EXPECT_NEAR(*contacts_of(scene, surface).self_thickness, 0.2 * (2 + M_SQRT2) / 3, 1e-12);
  scene.self_contact.thickness = 0.03;
  EXPECT_EQ(*contacts_of(scene, surface).self_thickness, 0.03);
}

}  // namespace
}  // namespace testbed::massspring
