// A scene's solid in motion: how it begins.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "fem_reference/solid/simulation.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

const Vector3d kVelocity(3, -1, 2), kSpin(0.5, 2, -1);

/// A box of 1 m x 0.5 m x 0.5 m that nothing holds.
struct FreeBox {
  TetMesh mesh = box_tets(2, 1, 1, 0.5);
  Scene scene;
  StageTimer timer;
  FreeBox() {
    scene.material = {1e6, 0.3, 1000, 0};
    scene.time.mode = TimeMode::Dynamic;
    scene.time.end = 0.1;
    scene.time.step = 1e-3;
    scene.initial.emplace_back();
  }
  Simulation simulation() { return {scene, {mesh.X, mesh.F}, mesh, timer}; }
};

Vector3d angular_momentum(const Simulation& simulation) {
  const Matrix3Xd& X = simulation.solid().X();
  const Eigen::VectorXd p = simulation.solid().mass() * simulation.motion()->v();
  const Matrix3Xd x = X + simulation.motion()->u().reshaped(3, X.cols());
  Vector3d sum = Vector3d::Zero();
  for (Eigen::Index i = 0; i < x.cols(); ++i) sum += x.col(i).cross(p.segment<3>(3 * i));
  return sum;
}

TEST(InitialMotion, CarriesAFreeBodyAtItsVelocity) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
    for (const int degree : {1, 2}) {
      box.scene.material.law = law;
      box.scene.reference.degree = degree;
      Simulation simulation = box.simulation();
      while (!simulation.has_ended()) simulation.advance();
      const Snapshot snapshot = simulation.snapshot();
      const Matrix3Xd expected = (kVelocity * snapshot.time).replicate(1, snapshot.u.cols());
      EXPECT_NEAR(snapshot.time, box.scene.time.end, 1e-12);
      EXPECT_LT((snapshot.u - expected).norm(), 1e-9 * expected.norm()) << degree;
    }
}

// Average acceleration keeps angular momentum at finite strain to the square of the step.
TEST(InitialMotion, SpinsAStiffBodyThatKeepsItsAngularMomentum) {
  FreeBox box;
  box.scene.initial[0].spin = kSpin;
  box.scene.material.E = 1e8;
  double lost[2] = {};
  for (const int divided : {1, 2}) {
    box.scene.time.step = 2e-3 / divided;
    Simulation simulation = box.simulation();
    const Vector3d before = angular_momentum(simulation);
    while (!simulation.has_ended()) simulation.advance();
    lost[divided - 1] = (angular_momentum(simulation) - before).norm() / before.norm();
    const Matrix3Xd& X = simulation.solid().X();
    const Vector3d centre(0.5, 0.25, 0.25);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(kSpin.norm() * simulation.motion()->t(), kSpin.normalized()).matrix();
    const Matrix3Xd turned = (turn * (X.colwise() - centre)).colwise() + centre;
    EXPECT_LT((X + simulation.snapshot().u - turned).norm(), 0.1 * (turned - X).norm());
  }
  EXPECT_LT(lost[1], 1e-4);
  EXPECT_LT(lost[1], lost[0] / 3);
}

TEST(InitialMotion, IsOverruledBySupports) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  Support face;
  face.region.shape = HalfSpace{Vector3d(0, 0, 0), Vector3d(1, 0, 0)};
  face.fixed = {{true, false, true}};
  box.scene.supports = {face};
  Simulation simulation = box.simulation();
  const auto velocity = [&](int node) { return Vector3d(simulation.motion()->v().segment<3>(3 * node)); };
  const int held = simulation.solid().held().at(0).node, free = static_cast<int>(box.mesh.X.cols()) - 1;
  EXPECT_EQ(velocity(held), Vector3d(0, kVelocity.y(), 0));
  EXPECT_EQ(velocity(free), kVelocity);
  for (int n = 0; n < 10; ++n) simulation.advance();
  for (const HeldComponent& h : simulation.solid().held()) {
    EXPECT_EQ(simulation.snapshot().u(h.component, h.node), 0);
    EXPECT_EQ(velocity(h.node)(h.component), 0);
  }
  EXPECT_GT(simulation.snapshot().u.col(free).norm(), 0);
}

}  // namespace
}  // namespace testbed::fem
