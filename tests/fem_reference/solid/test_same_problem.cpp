// Springs and elements are given the same problem on the surface.
#include <gtest/gtest.h>

#include <map>

#include "fem_reference/solid/problem.h"
#include "massspring/calibrations/calibrate.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "tests/meshing/box_tets.h"

namespace testbed {
namespace {

using Eigen::Vector3d;

/// A box of 2 m x 1 m x 1 m with two loads and two supports that overlap, one of them moving.
struct Boxed {
  TetMesh mesh = box_tets(4, 2, 2, 0.5);
  SurfaceMesh surface{mesh.X, mesh.F};
  Scene scene;

  Boxed() {
    scene.gravity = Vector3d(1, -9, 2);
    Load top, all;
    top.region.shape = Box{{0.5, 0, 1}, {2, 1, 1}};
    top.pressure = 30;
    top.traction = {4, 5, 6};
    StressTerm shear = StressTerm::Zero();
    shear(1) = 1;  // times y
    shear(7) = 7;  // Pa of xz, which the top feels
    top.stress = {shear};
    all.pressure = 11;
    scene.loads = {top, all};
    Support end, under;
    end.region.shape = Box{{0, 0, 0}, {0, 1, 1}};
    end.displacement = {0, 0.25, 0};
    under.region.shape = Box{{0, 0, 0}, {1, 1, 0}};
    under.fixed = {{false, true, true}};
    under.motion = {{0, 0, 0, 0}, {0.5, 0, 0.125, 0.5}, {1, 0, 0, 0}};
    scene.supports = {end, under};
    scene.reference.degree = 1;
  }

  massspring::Forces springs() const {
    const SpringNetwork network{mesh.X, mesh.F, {}, mesh.T, static_cast<int>(mesh.X.cols())};
    return forces_of(scene, discretise(scene, surface),
                     calibrate(network, scene.material, massspring::find_calibration("edge_coupled")));
  }
  fem::ElasticSolid elements() const { return fem::assemble_scene(scene, surface, mesh); }
};

TEST(SameProblem, LinearElementsTakeTheNodalLoadsOfTheSprings) {
  const Boxed box;
  const Eigen::VectorXd springs = box.springs().load.reshaped(), elements = box.elements().load();
  ASSERT_GT(springs.norm(), 100);
  EXPECT_LT((springs - elements).norm(), 1e-13 * springs.norm());
}

TEST(SameProblem, SupportsHoldTheSameComponentsAndMoveThemAlike) {
  const Boxed box;
  const fem::ElasticSolid solid = box.elements();
  for (const double t : {0.25, 0.5, 0.75, 1.}) {
    std::map<std::pair<int, int>, double> springs, elements;
    for (const massspring::Constraint& c : box.springs().constraints)
      for (int k = 0; k < 3; ++k)
        if (c.S(k, k) == 0) springs[{c.node, k}] = prescribed(c, t, 1)(k);
    for (size_t k = 0; k < solid.constrained().size(); ++k)  // the last support prescribes
      elements[{solid.constrained()[k].node, solid.constrained()[k].component}] =
          solid.constrained_displacement(static_cast<int>(k), t);
    ASSERT_EQ(springs.size(), 9u * 3 + 6 * 2);  // the end, and what else the underside's half has
    EXPECT_EQ(springs, elements) << t;
  }
}

TEST(SameProblem, FollowersAreWholeShellsAndPressSpringsAndElementsAtFiniteStrain) {
  Boxed box;
  Load follower;
  follower.pressure = 5;
  follower.is_follower = true;
  box.scene.loads.push_back(follower);
  box.scene.loads.push_back(follower);
  const massspring::Forces forces = box.springs();
  ASSERT_EQ(forces.surface.size(), 1u);
  const auto pressed = std::dynamic_pointer_cast<meshing::FollowerPressure>(forces.surface[0]);
  ASSERT_TRUE(pressed);
  EXPECT_EQ(pressed->pressure(), 10);
  EXPECT_EQ(pressed->faces().F, box.mesh.F);
  EXPECT_EQ(law_of(box.scene), MaterialLaw::NeoHookean);
  const Eigen::VectorXd with = box.elements().load();
  box.scene.loads.resize(2);
  const Eigen::VectorXd without = box.elements().load();
  EXPECT_EQ(with, without) << "it is no dead load";
  box.scene.loads[0].region.shape = Box{{0.5, 0, 1}, {2, 1, 1}};
  box.scene.loads[0].is_follower = true;
  EXPECT_THROW(discretise(box.scene, box.surface), std::runtime_error) << "a part of a shell";
}

TEST(SameProblem, ItsBytesTellEveryNumberFromOthers) {
  const Boxed box;
  const std::string bytes = bytes_of(discretise(box.scene, box.surface));
  EXPECT_EQ(bytes, bytes_of(discretise(box.scene, box.surface)));
  std::vector<Scene> others(7, box.scene);
  others[0].loads[0].pressure = 31;
  others[1].loads[0].traction.x() = 3;
  others[2].loads[0].stress[0](7) = 8;
  others[3].loads[1].is_follower = true;
  others[4].supports[0].displacement.y() = 0.5;
  others[5].supports[1].motion[1](3) = 0.25;
  others[6].supports[1].fixed[0] = true;
  for (const Scene& other : others) EXPECT_NE(bytes_of(discretise(other, box.surface)), bytes);
  Scene follows = others[3];
  follows.loads[1].pressure = 12;
  EXPECT_NE(bytes_of(discretise(follows, box.surface)), bytes_of(discretise(others[3], box.surface)));
}

}  // namespace
}  // namespace testbed
