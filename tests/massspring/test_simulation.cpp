// A scene's body in motion: how it begins.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "massspring/simulation.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

const Vector3d kVelocity(3, -1, 2), kSpin(0.5, 2, -1);

/// A box of 1 m x 0.5 m x 0.5 m that nothing holds, whose inner nodes lie anywhere.
struct FreeBox {
  TetMesh mesh = box_tets(4, 2, 2, 0.25, 0.1);
  SpringNetwork network{mesh.X, mesh.F, {}, mesh.T, mesh.n_surface};
  Scene scene;
  FreeBox() {
    scene.material = {1e6, 0.3, 1000, 0};
    scene.network.calibration = "node_averaged";
    scene.time.mode = TimeMode::Dynamic;
    scene.time.end = 0.1;
    scene.time.step = 1e-3;
    scene.initial.emplace_back();
  }
};

Vector3d angular_momentum(const Simulation& simulation) {
  const State& state = simulation.state();
  const Matrix3Xd p = momenta(simulation.model(), state.v);
  Vector3d sum = Vector3d::Zero();
  for (Eigen::Index i = 0; i < p.cols(); ++i) sum += state.x.col(i).cross(p.col(i));
  return sum;
}

TEST(InitialMotion, CarriesAFreeBodyAtItsVelocityByEveryIntegrator) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  for (const MaterialLaw law : {MaterialLaw::SmallStrain, MaterialLaw::NeoHookean})
    for (const Integrator& integrator : integrators()) {
      box.scene.material.law = law;
      box.scene.time.integrator = integrator.name;
      Simulation simulation(box.scene, box.network);
      while (!simulation.has_ended()) simulation.advance();
      const Matrix3Xd expected = (kVelocity * simulation.state().t).replicate(1, box.network.X.cols());
      EXPECT_NEAR(simulation.state().t, box.scene.time.end, 1e-12);
      EXPECT_LT((simulation.snapshot().u - expected).norm(), 1e-9 * expected.norm()) << integrator.name;
    }
}

TEST(InitialMotion, SpinsAStiffBodyThatKeepsItsAngularMomentum) {
  FreeBox box;
  box.scene.initial[0].spin = kSpin;
  box.scene.material.E = 1e8;
  box.scene.time.end = 0.02;
  struct Case {
    const char* integrator;
    double step, tolerance;  // midpoint's stages stop where a step is below 1e-9 of the body
  };
  for (const auto& [integrator, step, tolerance] :
       {Case{"symplectic_euler", 2e-5, 1e-11}, Case{"midpoint", 1e-3, 1e-5}}) {
    box.scene.time.integrator = integrator;
    box.scene.time.step = step;
    Simulation simulation(box.scene, box.network);
    const Vector3d before = angular_momentum(simulation);
    const Matrix3Xd X = simulation.state().x;
    const Vector3d centre = X * simulation.model().mass / simulation.model().mass.sum();
    while (!simulation.has_ended()) simulation.advance();
    const State& state = simulation.state();
    EXPECT_LT((angular_momentum(simulation) - before).norm(), tolerance * before.norm()) << integrator;
    // In a fiftieth of a second the axis of a body with unequal moments stays where it was, nearly.
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(kSpin.norm() * state.t, kSpin.normalized()).matrix();
    const Matrix3Xd turned = (turn * (X.colwise() - centre)).colwise() + centre;
    EXPECT_LT((state.x - turned).norm(), 0.02 * (turned - X).norm()) << integrator;
  }
}

TEST(InitialMotion, IsOverruledBySupports) {
  FreeBox box;
  box.scene.initial[0].velocity = kVelocity;
  Support face;
  face.region.shape = HalfSpace{Vector3d(0.05, 0, 0), Vector3d(1, 0, 0)};
  face.fixed = {{true, false, true}};
  box.scene.supports = {face};
  for (const char* integrator : {"symplectic_euler", "rk4", "midpoint"}) {
    box.scene.time.integrator = integrator;
    box.scene.time.step = 1e-5;
    Simulation simulation(box.scene, box.network);
    const int held = simulation.forces().constraints.at(0).node;
    EXPECT_EQ(simulation.state().v.col(held), Vector3d(0, kVelocity.y(), 0));
    EXPECT_EQ(simulation.state().v.rightCols(1), kVelocity);
    for (int n = 0; n < 10; ++n) simulation.advance();
    for (const Constraint& c : simulation.forces().constraints) {
      EXPECT_EQ(simulation.state().x(0, c.node), box.network.X(0, c.node)) << integrator;
      EXPECT_EQ(simulation.state().v(0, c.node), 0) << integrator;
    }
    EXPECT_GT(simulation.snapshot().u.rightCols(1).norm(), 0) << integrator;
  }
}

}  // namespace
}  // namespace testbed::massspring
