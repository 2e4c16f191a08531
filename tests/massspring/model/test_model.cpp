#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "massspring/model/model.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kRounding = 1e-12;

/// A box of 1 m x 2 m x 3 m of cubes of 1 m, whose nodes are all of the surface.
MassSpringModel box() {
  const TetMesh mesh = box_tets(1, 2, 3, 1);
  MassSpringModel model;
  model.network = mesh;
  model.mass = Eigen::VectorXd::LinSpaced(mesh.X.cols(), 1, 2);
  return model;
}

Support support_of(const Box& region, const std::array<bool, 3>& fixed, const Vector3d& displacement) {
  Support support;
  support.region.shape = region;
  support.fixed = fixed;
  support.displacement = displacement;
  return support;
}

TEST(ForcesOf, TheLastSupportThatHoldsAComponentPrescribesItsDisplacement) {
  const MassSpringModel model = box();
  Scene scene;
  scene.supports = {support_of({{0, 0, 0}, {1, 2, 0}}, {true, true, false}, {1, 2, 3}),  // the underside
                    support_of({{0, 0, 0}, {1, 0, 3}}, {true, false, true}, {4, 5, 6})};
  const Forces forces = forces_of(scene, discretise(scene, surface_of(model)), model);
  int n_under = 0, n_front = 0, n_both = 0;
  for (const Constraint& c : forces.constraints) {
    const Vector3d X = model.network.X.col(c.node);
    const bool is_under = X.z() == 0, is_front = X.y() == 0;
    n_under += is_under && !is_front;
    n_front += is_front && !is_under;
    n_both += is_front && is_under;
    const Vector3d expected = is_under && is_front ? Vector3d(4, 2, 6)
                              : is_under           ? Vector3d(1, 2, 0)
                                                   : Vector3d(4, 0, 6);
    EXPECT_EQ(prescribed(c, 1, 1), expected) << "at " << X.transpose();
    const Vector3d is_free(0, is_under ? 0 : 1, is_front ? 0 : 1);
    EXPECT_EQ(c.S, Eigen::Matrix3d(is_free.asDiagonal()));
  }
  EXPECT_EQ(n_under, 2 * 2);
  EXPECT_EQ(n_front, 2 * 3);
  EXPECT_EQ(n_both, 2);
}

// On top, of 2 m2, every triangle measures half a square and hands a third of its load to each corner.
TEST(ForcesOf, LoadsAreWeightAndPressureAndTractionTimesAreas) {
  const MassSpringModel model = box();
  Scene scene;
  const Vector3d gravity(0.5, 0, -10), traction(3, 4, 5);
  scene.gravity = gravity;
  Load load;
  load.region.shape = Box{{0, 0, 3}, {1, 2, 3}};
  load.pressure = 7;
  load.traction = traction;
  scene.loads = {load};
  const Forces forces = forces_of(scene, discretise(scene, surface_of(model)), model);
  const Matrix3Xd on_top = forces.load - gravity * model.mass.transpose();
  const Vector3d per_area = traction - Vector3d(0, 0, 7);
  EXPECT_LT((on_top.rowwise().sum() - 2 * per_area).norm(), kRounding);
  for (Eigen::Index i = 0; i < on_top.cols(); ++i) {
    double area = 0;
    for (const auto& t : model.network.F.colwise())
      if ((t.array() == i).any() && (model.network.X.row(2)(t).array() == 3).all()) area += 0.5 / 3;
    EXPECT_LT((on_top.col(i) - area * per_area).norm(), kRounding) << i;
  }
}

TEST(LargestStrain, IsThatOfTheTetrahedronThatIsStretchedMost) {
  const TetMesh mesh = box_tets(2, 2, 2, 0.5, 0.2);
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).matrix();
  const Vector3d stretch(1.1, 0.7, 1.2);  // 0.3 is the largest difference from one
  Matrix3Xd x = rotation * stretch.asDiagonal() * mesh.X;
  EXPECT_NEAR(largest_strain(mesh.X, mesh.T, x - mesh.X), 0.3, kRounding);
  EXPECT_NEAR(smallest_jacobian(mesh.X, mesh.T, x - mesh.X), stretch.prod(), kRounding);
  EXPECT_NEAR(smallest_jacobian(mesh.X, mesh.T, 0.2 * mesh.X), 1.2 * 1.2 * 1.2, kRounding) << "swollen";
  // Of one corner moved far, and of another moved little in a body that is stretched by a hundredth.
  for (const auto& [stretched, corner, move] :
       {std::tuple(1., mesh.T(0, 0), -0.4), std::tuple(1.01, mesh.T(3, mesh.T.cols() - 1), 0.03)}) {
    x = stretched * mesh.X;
    x.col(corner) += Vector3d(move, 0, 0);
    double first = 0, expected = 0, least = 1;
    for (const auto& t : mesh.T.colwise()) {
      Eigen::Matrix3d rest, now;
      for (int k = 0; k < 3; ++k) {
        rest.col(k) = mesh.X.col(t[k + 1]) - mesh.X.col(t[0]);
        now.col(k) = x.col(t[k + 1]) - x.col(t[0]);
      }
      const Eigen::Matrix3d F = now * rest.inverse();
      least = std::min(least, F.determinant());
      const Vector3d s = Eigen::JacobiSVD<Eigen::Matrix3d>(F).singularValues();
      expected = std::max(expected, (s.array() - 1).abs().maxCoeff());
      if (first == 0) first = expected;
    }
    ASSERT_GT(expected, stretched == 1 ? 0.3 : 5 * first);
    EXPECT_NEAR(largest_strain(mesh.X, mesh.T, x - mesh.X), expected, kRounding);
    EXPECT_NEAR(smallest_jacobian(mesh.X, mesh.T, x - mesh.X), least, kRounding);
  }
}

TEST(LargestStrain, OfSpringsIsThatOfTheirLengths) {
  const MassSpringModel model = small_model();
  Matrix3Xd x = 1.2 * model.network.X;
  EXPECT_NEAR(largest_strain(*model.springs, model.network.X, x), 0.2, kRounding);
  x.col(4) = model.network.X.col(4);
  x.col(0) = 0.5 * (x.col(0) + x.col(4));
  double expected = 0;
  for (const auto& e : model.springs->E.colwise()) {
    const auto length = [&](const Matrix3Xd& at) { return (at.col(e(0)) - at.col(e(1))).norm(); };
    expected = std::max(expected, std::abs(length(x) - length(model.network.X)) / length(model.network.X));
  }
  EXPECT_NEAR(largest_strain(*model.springs, model.network.X, x), expected, kRounding);
}

TEST(StiffnessBlocks, AreThoseOfThePatternOfTheMatrix) {
  MassSpringModel model = small_model();
  EXPECT_EQ(n_stiffness_blocks(model), 5 + 2 * 10);
  const TetMesh mesh = box_tets(1, 2, 3, 1);
  model = MassSpringModel();
  model.network = mesh;
  model.tet_springs = couple_springs(mesh.X, mesh.T, {1, 1}, kEdgeCoupled);
  std::set<std::pair<int, int>> blocks;
  for (const auto& t : mesh.T.colwise())
    for (int i : t)
      for (int j : t) blocks.insert({i, j});
  model.springs = Springs{mesh.T.topRows<2>(), Eigen::VectorXd::Ones(mesh.T.cols())};  // edges once more
  EXPECT_EQ(n_stiffness_blocks(model), static_cast<Eigen::Index>(blocks.size()));
}

std::map<std::pair<int, int>, double> stiffness_by_edge(const MassSpringModel& model) {
  std::map<std::pair<int, int>, double> found;
  for (Eigen::Index s = 0; s < model.springs->E.cols(); ++s)
    found[std::minmax(model.springs->E(0, s), model.springs->E(1, s))] += model.springs->stiffness(s);
  return found;
}

TEST(AddStiffness, IsMinusTheGradientOfAllForcesWhereSkinIsBent) {
  MassSpringModel model = small_model();
  add_skin({0, 3, 0}, model);
  State state = initial_state(model);
  const Matrix3Xd x = state.x + random_points(5, 0.2, 3), p = random_points(5, 1, 4);
  state.x = x;
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, state, K, Curvature::Exact);
  Matrix3Xd Kp;
  multiply(K, p, Kp);
  const auto forces_at = [&](double step) {
    state.x = x + step * p;
    return elastic_forces(model, state);
  };
  constexpr double kStep = 1e-6, kDifference = 1e-7;
  const Matrix3Xd difference = (forces_at(-kStep) - forces_at(kStep)) / (2 * kStep);
  EXPECT_LT((Kp - difference).norm(), kDifference * Kp.norm());
}

TEST(AddSkin, SpringsAlongTheSurfaceKeepTheirStiffnessBesideTheSkins) {
  MassSpringModel model = small_model(), alone = model;
  auto expected = stiffness_by_edge(model);
  alone.springs.reset();
  add_skin({3, 0, 0}, alone);
  for (const auto& [edge, stiffness] : stiffness_by_edge(alone)) {
    EXPECT_GT(stiffness, 0);
    expected[edge] += stiffness;
  }
  add_skin({3, 0, 0}, model);
  const auto found = stiffness_by_edge(model);
  ASSERT_EQ(found.size(), expected.size());
  for (const auto& [edge, stiffness] : expected)
    EXPECT_NEAR(found.at(edge), stiffness, kRounding * stiffness);
}

// Matrices of springs alone leave out whatever else there is.
TEST(SpringsAlone, AreAModelWithoutEnergyOfAnyOtherKind) {
  const MassSpringModel springs = small_model();
  EXPECT_TRUE(is_springs_alone(springs));
  const Eigen::Vector4i tet(0, 1, 2, 3);
  MassSpringModel with_tetrahedra = springs, with_bending = springs, with_volume = springs, none = springs;
  with_tetrahedra.tet_springs = couple_springs(springs.network.X, tet, {1, 1}, kEdgeCoupled);
  with_bending.bending = make_bending(springs.network.X, springs.network.F, 1);
  with_volume.local_volume = LocalVolume{50, tet, Eigen::VectorXd::Constant(1, 1. / 6)};
  none.springs.reset();
  for (const MassSpringModel& model : {with_tetrahedra, with_bending, with_volume, none})
    EXPECT_FALSE(is_springs_alone(model));
}

}  // namespace
}  // namespace testbed::massspring
