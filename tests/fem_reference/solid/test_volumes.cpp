// Volumes of elements that resist, and an enclosed volume that is held.
#include <gtest/gtest.h>

#include <cmath>

#include "meshing/surface_energies/volume_penalty.h"
#include "tests/fem_reference/dynamics_of.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using meshing::box_tets;
using namespace meshing;

const Material kMaterial{1e4, 0.3, 1000, 0};
constexpr double kKappa = 2e4;
constexpr double kHeld = 1e-9;  // of a volume: as exactly as it is held

/// Isotropic stress on the deformed area of a body that is s times as long in every direction (Pa).
double even_stress(double s, double kappa) {
  const LameConstants lame(kMaterial);
  const double J = s * s * s;
  return lame.mu * (1 / s - 1 / J) + lame.lambda / 2 * (J - 1 / J) + kappa * (J - 1);
}

Material with_more_bulk(double kappa) {
  const LameConstants lame(kMaterial);
  Material material = kMaterial;
  material.nu = (lame.lambda + kappa) / (2 * (lame.lambda + kappa + lame.mu));
  material.E = 2 * lame.mu * (1 + material.nu);
  return material;
}

class Volumes : public testing::TestWithParam<int> {
 protected:
  ElasticSolid box(int n) const { return {box_tets(n, n, n, 1. / n), GetParam()}; }
};
INSTANTIATE_TEST_SUITE_P(Degrees, Volumes, testing::Values(1, 2));

TEST_P(Volumes, OfElementsHaveForcesAndATangentThatAreDifferences) {
  constexpr double kStep = 1e-6, kDifference = 1e-5;
  ElasticSolid solid = box(2), plain = box(2);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {}, kKappa);
  plain.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {});
  for (ElasticSolid* of : {&solid, &plain}) of->set_shrinkage(VectorXd::Constant(27, 0.1));
  std::srand(1);
  const Matrix3Xd u = 0.03 * Matrix3Xd::Random(3, solid.X().cols()), d = Matrix3Xd::Random(3, u.cols());
  const auto force = [&](double s) -> VectorXd { return solid.linearise(u + s * d, 1, false).force; };
  const Linearisation at = solid.linearise(u);
  const double slope = (solid.energy(u + kStep * d) - solid.energy(u - kStep * d)) / (2 * kStep);
  EXPECT_NEAR(slope, at.force.dot(d.reshaped()), kDifference * at.force.norm() * d.norm());
  const VectorXd product = at.tangent * d.reshaped();
  EXPECT_LT((product - (force(kStep) - force(-kStep)) / (2 * kStep)).norm(), kDifference * product.norm());
  EXPECT_GT((product - plain.linearise(u).tangent * d.reshaped()).norm(), 0.1 * product.norm());
}

// As that of springs, which knows no points of quadrature.
TEST(VolumesOfElements, AddTheEnergyOfTheTetrahedraWhereStrainIsEvenInThem) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.3, 0.1);
  ElasticSolid solid(mesh, 1), plain(mesh, 1);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {}, kKappa);
  plain.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {});
  std::srand(1);
  const Matrix3Xd u = 0.02 * Matrix3Xd::Random(3, mesh.X.cols());
  double expected = 0;
  for (const auto& t : mesh.T.colwise()) {
    const double rest = volume_of(mesh.X, t), excess = volume_of(mesh.X + u, t) - rest;
    expected += kKappa / 2 * excess * excess / rest;
  }
  EXPECT_NEAR(solid.energy(u) - plain.energy(u), expected, 1e-10 * solid.energy(u));
  EXPECT_GT(expected, 0.05 * solid.energy(u));
}

TEST_P(Volumes, OfElementsAddToTheBulkModulusAtRest) {
  ElasticSolid solid = box(2), bulky = box(2);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {}, kKappa);
  bulky.assemble(with_more_bulk(kKappa), ElasticLaw::NeoHookean, {}, {});
  const Eigen::SparseMatrix<double> K = bulky.stiffness();
  EXPECT_LT((solid.stiffness() - K).norm(), 1e-12 * K.norm());
}

TEST_P(Volumes, OfElementsResistAnEvenPressureAsTheLawSays) {
  constexpr double kPressure = 3e3;
  ElasticSolid solid = box(2);
  const Matrix3Xd X = solid.X();
  ElasticLoads loads;
  loads.follower_pressure = [](int) { return kPressure; };
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, rollers(X), kKappa);
  ASSERT_TRUE(solid.solve().is_converged);
  double low = 0.5, high = 1;
  for (int n = 0; n < 60; ++n)
    (even_stress((low + high) / 2, kKappa) < -kPressure ? low : high) = (low + high) / 2;
  EXPECT_LT(low, 0.98);
  EXPECT_LT(
      largest_error(X, solid.displacement(), [&](const Vector3d& x) -> Vector3d { return (low - 1) * x; }),
      1e-8);
}

// Swinging so little that it is linear.
TEST_P(Volumes, OfElementsSwingAsABodyOfMoreBulk) {
  ElasticSolid solid = box(2), bulky = box(2);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {}, kKappa);
  bulky.assemble(with_more_bulk(kKappa), ElasticLaw::NeoHookean, {}, {});
  std::srand(1);
  const VectorXd v = 1e-5 * VectorXd::Random(solid.n_dofs());
  const auto end_of = [&](ElasticSolid& of) {
    GeneralisedAlpha motion(dynamics_of(of), 0.02, kNewmark);
    motion.restart(VectorXd::Zero(v.size()), v);
    for (int n = 0; n < 20; ++n) EXPECT_TRUE(motion.step());
    return motion.u();
  };
  const VectorXd u = end_of(bulky);
  EXPECT_LT((end_of(solid) - u).norm(), 1e-3 * u.norm());
}

std::shared_ptr<HeldVolume> held(const ElasticSolid& solid, const Curve& target) {
  const Faces faces = faces_of(solid.faces());
  return std::make_shared<HeldVolume>(kMaterial.E, faces,
                                      TargetVolume{volume_of(faces, solid.X()), target, false});
}

/// Over that at rest.
double volume_at(const ElasticSolid& solid, const Matrix3Xd& u) {
  const Faces faces = faces_of(solid.faces());
  return volume_of(faces, solid.X() + u) / volume_of(faces, solid.X());
}

// At small strain that is the bulk modulus times the change of volume.
TEST_P(Volumes, ThatAreHeldTakeThePressureOfTheLaw) {
  for (const double target : {1.0001, 1.4, 0.7}) {
    ElasticSolid solid = box(2);
    ElasticLoads loads;
    const auto volume = held(solid, {{0, 1}, {1, target}});
    loads.surface = {volume};
    solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
    for (int n = 1; n <= 4; ++n) {
      ASSERT_TRUE(solid.solve(n / 4.).is_converged) << target;
      EXPECT_NEAR(volume_at(solid, solid.displacement()), 1 + n / 4. * (target - 1), kHeld);
    }
    const double expected = even_stress(std::cbrt(target), 0), K = kMaterial.E / (3 * (1 - 2 * kMaterial.nu));
    EXPECT_NEAR(*volume->holding_pressure(), expected, 1e-4 * std::abs(expected)) << target;
    if (target == 1.0001) {
      EXPECT_NEAR(*volume->holding_pressure(), K * (target - 1), 1e-3 * K * (target - 1));
    }
  }
}

TEST_P(Volumes, ThatAreHeldUnderLoadFeelTheFollowerPressureThatHoldsThem) {
  ElasticSolid free = box(3), solid = box(3), pressed = box(3);
  std::vector<ConstrainedComponent> clamp;
  for (int i = 0; i < solid.X().cols(); ++i)
    for (int c = 0; c < 3 && solid.X()(1, i) == 0; ++c) clamp.push_back({i, c, 0});
  ElasticLoads loads;
  loads.body_force = [](const Vector3d&) { return Vector3d(500, -2000, 0); };
  free.assemble(kMaterial, ElasticLaw::NeoHookean, loads, clamp);
  ASSERT_TRUE(free.solve().is_converged);
  EXPECT_GT(std::abs(volume_at(free, free.displacement()) - 1), 0.01) << "it would not keep its volume";
  const auto volume = held(solid, {{0, 1}});
  loads.surface = {volume};
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, clamp);
  for (const double factor : {0.5, 1.}) {
    ASSERT_TRUE(solid.solve(factor).is_converged);
    EXPECT_NEAR(volume_at(solid, solid.displacement()), 1, kHeld);
  }
  const double pressure = *volume->holding_pressure();
  EXPECT_GT(pressure, 100);
  loads.surface = {};
  loads.follower_pressure = [=](int) { return -pressure; };
  pressed.assemble(kMaterial, ElasticLaw::NeoHookean, loads, clamp);
  ASSERT_TRUE(pressed.solve().is_converged);
  EXPECT_LT((pressed.displacement() - solid.displacement()).norm(), 1e-6 * solid.displacement().norm());

  // The pressure is part of the state, which another solid goes on from.
  const ElasticState state = solid.state();
  ASSERT_TRUE(solid.solve(0.1).is_converged);
  EXPECT_LT(*volume->holding_pressure(), pressure / 2);
  solid.set_state(state);
  EXPECT_EQ(*volume->holding_pressure(), pressure);
}

/// Up and down by a tenth in 0.4 s.
Curve smooth_target() {
  Curve target;
  for (int n = 0; n <= 400; ++n) target.push_back({n * 1e-3, 1 + 0.05 * (1 - std::cos(2 * M_PI * n / 400.))});
  return target;
}

TEST_P(Volumes, ThatAreHeldInMotionKeepMomentaAndGoOnFromAState) {
  ElasticSolid solid = box(2), other = box(2);
  const auto motion_of = [&](ElasticSolid& of) {
    ElasticLoads loads;
    loads.surface = {held(of, smooth_target())};
    of.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
    return GeneralisedAlpha(dynamics_of(of), 0.01, kImplicitEuler);
  };
  GeneralisedAlpha motion = motion_of(solid), rest = motion_of(other);
  const Dynamics system = dynamics_of(solid);
  const Matrix3Xd X = solid.X();
  Matrix3Xd v(3, X.cols());
  for (int i = 0; i < X.cols(); ++i) v.col(i) = Vector3d(1, 2, 3) + Vector3d(0, 0, 2).cross(X.col(i));
  motion.restart(VectorXd::Zero(v.size()), v.reshaped());
  const double upward = momentum_of(system, motion.v(), 2);
  MotionState state;
  for (int n = 1; n <= 30; ++n) {
    ASSERT_TRUE(motion.advance()) << n;
    const Matrix3Xd u = motion.u().reshaped(3, X.cols());
    EXPECT_NEAR(volume_at(solid, u), value_at(smooth_target(), 0.01 * n), kHeld) << n;
    EXPECT_NEAR(momentum_of(system, motion.v(), 2), upward, 1e-8 * upward) << n;
    if (n == 15) state = motion.state();
  }
  ASSERT_EQ(state.surface.size(), 1u);
  EXPECT_NE(state.surface[0]->pressure, 0);
  EXPECT_NEAR(motion.t(), 0.3, 1e-12);
  rest.set_state(state);
  EXPECT_EQ(*rest.surface()[0]->holding_pressure(), state.surface[0]->pressure);
  for (int n = 0; n < 15; ++n) ASSERT_TRUE(rest.advance());
  EXPECT_LT((rest.u() - motion.u()).norm(), 1e-7 * motion.u().norm());
  const double pressure = *motion.surface()[0]->holding_pressure();
  EXPECT_NEAR(*rest.surface()[0]->holding_pressure(), pressure, 1e-5 * std::abs(pressure));
}

// What the target does goes into the body, but for what implicit Euler loses, which halves with the step.
TEST_P(Volumes, ThatAreHeldDoTheWorkThatTheBodyHas) {
  double lost[2];
  for (const int k : {0, 1}) {
    ElasticSolid solid = box(2);
    ElasticLoads loads;
    loads.surface = {held(solid, smooth_target())};
    solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
    GeneralisedAlpha motion(dynamics_of(solid), 0.01 / (k + 1), kImplicitEuler);
    for (int n = 0; n < 20 * (k + 1); ++n) ASSERT_TRUE(motion.advance());
    const double has = motion.kinetic_energy() + motion.elastic_energy(),
                 work = motion.ledger().flows.targets;
    EXPECT_GT(has, 10);
    lost[k] = (work - has) / has;
  }
  EXPECT_LT(std::abs(lost[0]), 0.2);
  EXPECT_NEAR(lost[1] / lost[0], 0.5, 0.1);
}

}  // namespace
}  // namespace testbed::fem
