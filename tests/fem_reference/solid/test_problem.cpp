// What the reference makes of a scene: loads against integrals over its box, supports against its
// coordinates.
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "fem_reference/solid/problem.h"
#include "meshing/scene/surface_problem.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kRounding = 1e-12;

TEST(UnmodelledPart, NamesWhatTheReferenceLeavesOut) {
  const Scene still;
  Scene moving;
  moving.time.mode = TimeMode::Dynamic;
  EXPECT_EQ(unmodelled_part(still), "");
  EXPECT_EQ(unmodelled_part(moving), "");
  const auto part_with = [](Scene scene, auto change) {
    change(scene);
    const std::string part = unmodelled_part(scene);
    return part.substr(0, part.find(':'));
  };
  for (const Scene& scene : {still, moving})
    EXPECT_EQ(part_with(scene, [](Scene& s) { s.obstacles.emplace_back(); }), "");
  EXPECT_EQ(part_with(moving,
                      [](Scene& s) {
                        s.obstacles.emplace_back();
                        s.reference.integrator = "central_differences";
                      }),
            "obstacles with reference.integrator = central_differences");
  EXPECT_EQ(part_with(moving, [](Scene& s) { s.self_contact.is_on = true; }), "");
  EXPECT_EQ(part_with(moving,
                      [](Scene& s) {
                        s.self_contact.is_on = true;
                        s.reference.integrator = "central_differences";
                      }),
            "self_contact with reference.integrator = central_differences");
  EXPECT_EQ(part_with(still, [](Scene& s) { s.seams.emplace_back(); }), "");
  for (const Scene& scene : {still, moving})
    EXPECT_EQ(part_with(scene,
                        [](Scene& s) {
                          s.volume.emplace().coefficient = 1;
                          s.skin = Skin{1, 1, 1};
                        }),
              "");
  EXPECT_EQ(part_with(still, [](Scene& s) { s.volume.emplace().local = 1; }), "");
  EXPECT_EQ(part_with(still, [](Scene& s) { s.volume.emplace().is_exact = true; }), "");
  for (const std::string integrator : {"generalised_alpha", "central_differences", "minimising_euler"})
    EXPECT_EQ(
        part_with(moving,
                  [&](Scene& s) {
                    s.volume.emplace().is_exact = true;
                    s.reference.integrator = integrator;
                  }),
        integrator == "minimising_euler" ? "" : "volume.exact with reference.integrator = " + integrator);
  EXPECT_EQ(part_with(moving,
                      [](Scene& s) {
                        s.volume.emplace().coefficient = 1;
                        s.reference.integrator = "central_differences";
                      }),
            "volume.coefficient with reference.integrator = central_differences");
  for (const Scene& scene : {still, moving})
    EXPECT_EQ(part_with(scene, [](Scene& s) { s.collapse.emplace().pivots.emplace_back().end = 1; }), "");
  EXPECT_EQ(part_with(still, [](Scene& s) { s.reference.inertia_relief = true; }), "");
  EXPECT_EQ(part_with(moving, [](Scene& s) { s.reference.inertia_relief = true; }),
            "reference.inertia_relief");
  EXPECT_EQ(part_with(moving,
                      [](Scene& s) {
                        s.reference.integrator = "central_differences";
                        s.material.stiffness_damping = 0.1;
                      }),
            "material.stiffness_damping with reference.integrator = central_differences");
  const auto damp_at_finite_strain = [](Scene& s) {
    s.material.law = MaterialLaw::NeoHookean;
    s.material.stiffness_damping = 0.1;
  };
  EXPECT_EQ(part_with(moving, damp_at_finite_strain), "material.stiffness_damping at finite strain");
  EXPECT_EQ(part_with(still, damp_at_finite_strain), "");
}

/// Points on the end x = 2 of the box.
Region far_end() {
  return {HalfSpace{Vector3d(2, 0, 0), Vector3d(-1, 0, 0)}};
}

/// A box of 2 x 1 x 1 m, all of whose nodes are its surface's.
struct Box211 {
  TetMesh mesh = box_tets(2, 1, 1, 1);
  Scene scene;
  ElasticSolid solid(int degree, int refine) {
    scene.reference.degree = degree;
    scene.reference.refine = refine;
    return assemble_scene(scene, {mesh.X, mesh.F}, mesh);
  }
};

/// Force and torque about the origin of the assembled load.
std::pair<Vector3d, Vector3d> resultant(const ElasticSolid& solid) {
  const Eigen::VectorXd load = solid.load();
  Vector3d force = Vector3d::Zero(), torque = force;
  for (int i = 0; i < solid.X().cols(); ++i) {
    force += load.segment<3>(3 * i);
    torque += solid.X().col(i).cross(load.segment<3>(3 * i));
  }
  return {force, torque};
}

class Problem : public testing::TestWithParam<std::pair<int, int>>, protected Box211 {
 protected:
  ElasticSolid assembled() { return solid(GetParam().first, GetParam().second); }
};
INSTANTIATE_TEST_SUITE_P(DegreeAndRefinement, Problem,
                         testing::Values(std::pair(1, 0), std::pair(2, 0), std::pair(1, 1), std::pair(2, 1)));

TEST_P(Problem, WeighsWhatTheBoxDoes) {
  scene.material.rho = 700;
  scene.gravity = Vector3d(1, 2, -9);
  const auto [force, torque] = resultant(assembled());
  const Vector3d expected = 700 * 2 * *scene.gravity;
  EXPECT_LT((force - expected).norm(), kRounding * expected.norm());
  EXPECT_LT((torque - Vector3d(1, 0.5, 0.5).cross(expected)).norm(), kRounding * expected.norm());
}

// On the end x = 2 of normal (1, 0, 0): -p n + t, and the field sigma_xy = 6 y of column (0, 6 y, 0).
TEST_P(Problem, SumsPressureTractionAndStressOverTheTrianglesOfTheirRegion) {
  Load load;
  load.region = far_end();
  load.pressure = 5;
  load.traction = {1, 2, 3};
  StressTerm shear = StressTerm::Zero();
  shear(1) = 1;
  shear(8) = 6;
  load.stress = {shear};
  scene.loads = {load, load};
  const auto [force, torque] = resultant(assembled());
  const Vector3d even(1 - 5, 2, 3), sheared(0, 3, 0);  // N, at the centre of the end and at y = 2/3
  const Vector3d arm(2, 0.5, 0.5), arm_of_shear(2, 2. / 3, 0.5);
  EXPECT_LT((force - 2 * (even + sheared)).norm(), kRounding * force.norm());
  EXPECT_LT((torque - 2 * (arm.cross(even) + arm_of_shear.cross(sheared))).norm(), kRounding * torque.norm());
}

TEST_P(Problem, TakesAStressWhereItIsThoughSupportsAreOblique) {
  Load load;
  load.region = far_end();
  StressTerm shear = StressTerm::Zero();
  shear(1) = 1;
  shear(8) = 6;
  load.stress = {shear};
  scene.loads = {load};
  const auto [force, torque] = resultant(assembled());
  scene.supports.resize(1);
  scene.supports[0].region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  scene.supports[0].normal = Vector3d(1, 2, 0);
  const Eigen::Matrix3d frame = frame_of(scene.supports).value();
  EXPECT_GT((frame - Eigen::Matrix3d::Identity()).norm(), 0.1);
  const auto [seen, turned] = resultant(assembled());
  EXPECT_LT((frame * seen - force).norm(), kRounding * force.norm());
  EXPECT_LT((frame * turned - torque).norm(), kRounding * torque.norm());
}

TEST_P(Problem, HoldsEveryNodeOfARegionAndNoOther) {
  Support support;
  support.region = far_end();
  support.fixed = {{true, false, true}};
  scene.supports = {support};
  const ElasticSolid solid = assembled();
  std::set<std::pair<int, int>> expected, constrained;
  for (int i = 0; i < solid.X().cols(); ++i)
    if (solid.X()(0, i) == 2) expected.insert({{i, 0}, {i, 2}});
  for (const ConstrainedComponent& h : solid.constrained()) constrained.insert({h.node, h.component});
  EXPECT_GT(constrained.size(), 0u);
  EXPECT_EQ(constrained, expected);
}

TEST(ProblemOfAScene, MovesSupportsEvenlyToTheEndOrAlongTheirPath) {
  Box211 box;
  Support even, path;
  even.region = path.region = far_end();
  even.displacement = {0, 0.2, 0};
  path.motion = {{0, 0, 0, 0}, {1, 0.4, 0, 0}, {3, 0, 0, 0}};
  box.scene.supports = {even, path};
  box.scene.time.end = 4;
  for (TimeMode mode : {TimeMode::Static, TimeMode::Dynamic}) {
    box.scene.time.mode = mode;
    const ElasticSolid solid = box.solid(1, 0);
    const int n = static_cast<int>(solid.constrained().size());
    ASSERT_EQ(n, 2 * 3 * 4);
    EXPECT_NEAR(solid.constrained_displacement(1, 0.5), 0.2 * 0.5 / (mode == TimeMode::Static ? 1 : 4),
                kRounding);
    EXPECT_NEAR(solid.constrained_displacement(n / 2, 0.5), 0.2, kRounding);  // on its way to 0.4 m
    EXPECT_NEAR(solid.constrained_displacement(n / 2, 2), 0.2, kRounding);    // and on its way back
  }
}

// From pivots far away a body shrinks evenly. One that starts half-way has then done nothing, and its whole
// part at the end; parts multiply.
TEST(ProblemOfAScene, ShrinksAroundItsPivotsByTheProductOfTheirParts) {
  constexpr double kFar = 1e7, kPart = 0.1, kEven = 1e-5;
  Box211 box;
  Collapse collapse;
  collapse.coefficient = kPart * kFar;  // eq. 8 divides by 1 + distance over the smallest side, 1 m
  collapse.pivots = {{Vector3d(kFar, 0, 0), {}, 0, {}}, {Vector3d(0, kFar, 0), {}, 0.5, {}}};
  box.scene.collapse = collapse;
  ElasticSolid solid = box.solid(2, 0);
  for (const auto& [factor, length] : {std::pair(0.5, 1 - kPart / 2),
                                       {0.75, (1 - 0.75 * kPart) * (1 - kPart / 2)},
                                       {1.0, std::pow(1 - kPart, 2)}}) {
    ASSERT_TRUE(solid.solve(factor).is_converged);
    const Matrix3Xd expected = without_rigid_motion(solid.X(), (length - 1) * solid.X());
    EXPECT_LT((without_rigid_motion(solid.X(), solid.displacement()) - expected).norm(),
              kEven * expected.norm());
  }
}

/// Bars of 0.5 m along x, one behind the other at a gap.
TetMesh two_bars(double gap) {
  const TetMesh bar = box_tets(4, 2, 2, 0.125);
  const auto n = static_cast<int>(bar.X.cols());
  TetMesh both{Matrix3Xd(3, 2 * n), Eigen::Matrix4Xi(4, 2 * bar.T.cols()),
               Eigen::Matrix3Xi(3, 2 * bar.F.cols()), 2 * n};
  both.X << bar.X, bar.X.colwise() + Vector3d(0.5 + gap, 0, 0);
  both.F << bar.F, (bar.F.array() + n).matrix();
  both.T << bar.T, (bar.T.array() + n).matrix();
  return both;
}

// A part that no support holds hangs on its seam, whose stitches carry its weight when they have closed the gap.
TEST(ProblemOfAScene, SewsPartsTogetherAtTheVerticesOfTheSurface) {
  constexpr double kGap = 0.05, kStitch = 1e6;
  const TetMesh parts = two_bars(kGap);
  Scene scene;
  scene.material = {1e6, 0.3, 1000, 0};
  scene.material.law = MaterialLaw::NeoHookean;
  scene.gravity = Vector3d(30, 0, 0);
  Support clamp;
  clamp.region.shape = HalfSpace{Vector3d(1e-3, 0, 0), Vector3d(1, 0, 0)};
  scene.supports = {clamp};
  scene.seams = {
      {{Box{{0.5, -1, -1}, {0.5, 1, 1}}}, {Box{{0.5 + kGap, -1, -1}, {0.5 + kGap, 1, 1}}}, kStitch}};
  for (const int degree : {1, 2}) {
    scene.reference.degree = degree;
    ElasticSolid solid = assemble_scene(scene, {parts.X, parts.F}, parts);
    ASSERT_TRUE(solid.solve().is_converged) << degree;
    const Matrix3Xd x = solid.X() + solid.displacement();
    const Eigen::Index n = parts.X.cols() / 2;
    Vector3d force = Vector3d::Zero();
    int n_stitches = 0;
    for (Eigen::Index a = 0; a < n; ++a) {
      if (parts.X(0, a) != 0.5) continue;
      Eigen::Index b;
      (parts.X.rightCols(n).colwise() - parts.X.col(a)).colwise().norm().minCoeff(&b);
      force += kStitch * (x.col(n + b) - x.col(a));
      ++n_stitches;
    }
    const Vector3d weight = 1000 * 0.5 * 0.25 * 0.25 * *scene.gravity;
    EXPECT_EQ(n_stitches, 9);
    EXPECT_LT((force - weight).norm(), 1e-6 * weight.norm()) << degree;
  }
}

TEST(ProblemOfAScene, IsProportionalOnlyWhereItsSolutionIs) {
  Scene scene;
  EXPECT_TRUE(is_proportional(scene));
  scene.collapse = Collapse{};
  scene.collapse->pivots = {{Vector3d::Zero(), {}, 0, {}}};
  EXPECT_TRUE(is_proportional(scene));
  Scene later = scene, two = scene, finite = scene, moved = scene, ended = scene, wandering = scene,
        least = scene;
  ended.collapse->pivots[0].end = 0.5;
  wandering.collapse->pivots[0].motion = {{0, 0, 0, 0}, {1, 1, 0, 0}};
  least.collapse->least = 1 - least.collapse->coefficient / 2;
  later.collapse->pivots[0].start = 0.5;
  two.collapse->pivots.push_back(two.collapse->pivots[0]);
  finite.material.law = MaterialLaw::NeoHookean;
  moved.supports.emplace_back();
  moved.supports[0].motion = {{0, 0, 0, 0}};
  for (const Scene& other : {later, two, finite, moved, ended, wandering, least})
    EXPECT_FALSE(is_proportional(other));
}

}  // namespace
}  // namespace testbed::fem
