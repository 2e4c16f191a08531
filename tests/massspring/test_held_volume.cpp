// A scene whose enclosed volume is held exactly.
#include <gtest/gtest.h>

#include <cmath>

#include "massspring/simulation.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/volume_penalty.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double kHeld = 1e-9;  // of a volume: as exactly as it is held

struct Box {
  TetMesh mesh = box_tets(3, 2, 2, 0.25);
  SpringNetwork network{mesh.X, mesh.F, {}, mesh.T, mesh.n_surface};
  Scene scene;
  explicit Box(double target) {
    scene.material = {1e5, 0.3, 1000, 0};
    scene.material.law = MaterialLaw::NeoHookean;
    scene.volume.emplace().is_exact = true;
    scene.volume->target = {{0, 1}, {1, target}};
    scene.time.load_steps = 4;
  }
  double volume_of(const Simulation& simulation) const {
    return volume(simulation.state().x, mesh.F) / volume(mesh.X, mesh.F);
  }
};

double pressure_of(const Simulation& simulation) {
  for (const auto& [name, value] : simulation.snapshot().contact)
    if (name == "volume_pressure") return value;
  ADD_FAILURE() << "no pressure in curves.csv";
  return 0;
}

/// Isotropic stress of the law on the deformed area of a body of a volume over that at rest (Pa).
double even_stress(const Material& m, double J) {
  const double mu = m.E / (2 * (1 + m.nu)), lambda = 2 * mu * m.nu / (1 - 2 * m.nu);
  return mu * (1 / std::cbrt(J) - 1 / J) + lambda / 2 * (J - 1 / J);
}

TEST(HeldVolume, OfAFreeBodyTakesThePressureOfTheLaw) {
  for (const double target : {1.0001, 1.4, 0.7})
    for (const char* calibration : {"node_averaged", "edge_coupled"}) {
      Box box(target);
      box.scene.network.calibration = calibration;
      Simulation simulation(box.scene, box.network);
      for (int n = 1; n <= 4; ++n) {
        ASSERT_EQ(simulation.advance(), Status::Ok) << simulation.report().reason;
        EXPECT_NEAR(box.volume_of(simulation), 1 + n / 4. * (target - 1), kHeld) << calibration;
      }
      const double expected = even_stress(box.scene.material, target);
      EXPECT_NEAR(pressure_of(simulation), expected, 1e-4 * std::abs(expected)) << calibration << target;
    }
}

TEST(HeldVolume, IsKeptUnderLoadAndItsPressureIsOfTheState) {
  Box box(1);
  Support clamp;
  clamp.region.shape = HalfSpace{Vector3d(0, 1e-3, 0), Vector3d(0, 1, 0)};
  box.scene.supports = {clamp};
  box.scene.gravity = Vector3d(5, -50, 0);
  Scene free = box.scene;
  free.volume.reset();
  Simulation unheld(free, box.network), held(box.scene, box.network);
  State middle;
  double pressure = 0;
  for (int n = 1; n <= 4; ++n) {
    ASSERT_EQ(unheld.advance(), Status::Ok);
    ASSERT_EQ(held.advance(), Status::Ok) << held.report().reason;
    EXPECT_NEAR(box.volume_of(held), 1, kHeld);
    if (n != 2) continue;
    middle = held.state();
    pressure = pressure_of(held);
  }
  EXPECT_GT(std::abs(box.volume_of(unheld) - 1), 0.01);
  EXPECT_GT(pressure_of(held), 1.5 * pressure);
  held.set_state(middle);
  EXPECT_EQ(pressure_of(held), pressure);
}

TEST(HeldVolume, DoesItsPressuresWorkOnTheWayOfAStepToItsTarget) {
  const Box box(1.2);
  const Matrix3Xd &X = box.mesh.X, x = std::cbrt(1.2) * X;
  const double V = volume(X, box.mesh.F);
  meshing::HeldVolume held(1e5, meshing::Faces{box.mesh.F}, target_volume_of(box.scene, V));
  held.begin_step(0, 1, X);
  EXPECT_TRUE(held.renew(X)) << "more pressure";
  EXPECT_FALSE(held.renew(x)) << "it is there";
  const double pressure = held.holding_pressure().value();
  EXPECT_GT(pressure, 1e4);
  EXPECT_NEAR(held.work(x), pressure * 0.2 * V, 1e-8 * pressure * V);
}

struct InMotion : testing::TestWithParam<const char*> {};

TEST_P(InMotion, KeepsMomentumAndGoesOnFromItsStateBitForBit) {
  Box box(1.2);
  box.scene.time.mode = TimeMode::Dynamic;
  box.scene.time.integrator = GetParam();
  box.scene.time.step = 0.01;
  box.scene.time.end = 0.3;
  box.scene.initial.emplace_back();
  box.scene.initial[0].velocity = {1, 2, 3};
  box.scene.initial[0].spin = {0, 0, 2};
  Simulation whole(box.scene, box.network), other(box.scene, box.network);
  const auto momentum = [](const Simulation& of) -> Vector3d {
    return momenta(of.model(), of.state().v).rowwise().sum();
  };
  const Vector3d first = momentum(whole);
  std::string saved;
  for (int n = 1; n <= 20; ++n) {
    ASSERT_EQ(whole.advance(), Status::Ok);
    EXPECT_NEAR(box.volume_of(whole), 1 + 0.2 * whole.state().t, kHeld) << n;
    EXPECT_LT((momentum(whole) - first).norm(), 1e-8 * first.norm()) << n;
    if (n == 10) saved = whole.saved();
  }
  EXPECT_NE(pressure_of(whole), 0);
  other.restore(saved);
  EXPECT_NE(pressure_of(other), 0);
  for (int n = 0; n < 10; ++n) ASSERT_EQ(other.advance(), Status::Ok);
  EXPECT_EQ(other.state().x, whole.state().x);
  EXPECT_EQ(pressure_of(other), pressure_of(whole));
}

INSTANTIATE_TEST_SUITE_P(HeldVolume, InMotion, testing::Values("minimising_euler", "bdf2"));

}  // namespace
}  // namespace testbed::massspring
