// Energies of the surface on solids of either degree, which know nothing of them.
#include <gtest/gtest.h>

#include <Eigen/LU>

#include "meshing/surface_energies/barrier.h"
#include "meshing/surface_energies/membrane.h"
#include "meshing/surface_energies/seams.h"
#include "meshing/surface_energies/surface_points.h"
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

/// Nodes at the far corners of a box, which no tetrahedron joins.
std::shared_ptr<SurfaceEnergy> seam_across(const Matrix3Xd& X, double stiffness) {
  Seams seams{Eigen::Matrix2Xi(2, 1), VectorXd::Constant(1, stiffness)};
  X.colwise().sum().minCoeff(&seams.E(0, 0));
  X.colwise().sum().maxCoeff(&seams.E(1, 0));
  return std::make_shared<PlainEnergy<Seams>>(seams);
}

std::shared_ptr<SurfaceEnergy> bag(const ElasticSolid& solid, double target) {
  const Faces faces = faces_of(solid.faces());
  return std::make_shared<VolumePenalty>(2e4, faces, target * volume_of(faces, solid.X()));
}

/// A barrier at points of quadrature of all faces, each with one square metre of them.
std::shared_ptr<SurfaceEnergy> barrier_on_faces(const ElasticSolid& solid,
                                                const std::vector<RigidBody>& bodies, double kappa) {
  Matrix3Xd places = Matrix3Xd::Constant(3, 3, 1. / 6);
  places.diagonal().setConstant(2. / 3);
  const SurfacePoints W = points_on(solid.faces(), places, solid.X().cols());
  const Matrix3Xd& X = solid.X();
  const double range = 1e-3 * (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).norm();
  return std::make_shared<EnergyOfPoints>(
      std::make_shared<Barrier>(VectorXd::Ones(W.rows()), range, kappa, bodies), W);
}

class OnSurfaces : public testing::TestWithParam<int> {
 protected:
  ElasticSolid box(int n) const { return {box_tets(n, n, n, 1. / n), GetParam()}; }
};
INSTANTIATE_TEST_SUITE_P(Degrees, OnSurfaces, testing::Values(1, 2));

TEST_P(OnSurfaces, ForceIsTheGradientOfTheEnergyAndTheTangentItsOwn) {
  constexpr double kStep = 1e-6, kDifference = 1e-5;
  ElasticSolid solid = box(2);
  ElasticLoads loads;
  loads.follower_pressure = [](int) { return 300; };
  loads.surface = {seam_across(solid.X(), 5e4), bag(solid, 0.8),
                   std::make_shared<Membrane>(solid.X(), flat_triangles(solid.faces()), 3e3, 0.3)};
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
  std::srand(1);
  const Matrix3Xd u = 0.02 * Matrix3Xd::Random(3, solid.X().cols()), d = Matrix3Xd::Random(3, u.cols());
  const auto force = [&](double s) -> VectorXd { return solid.linearise(u + s * d, 0.7, false).force; };
  const Linearisation at = solid.linearise(u, 0.7);
  const double slope = (solid.energy(u + kStep * d, 0.7) - solid.energy(u - kStep * d, 0.7)) / (2 * kStep);
  EXPECT_NEAR(slope, at.force.dot(d.reshaped()), kDifference * at.force.norm() * d.norm());
  ASSERT_EQ(at.roots.size(), 1u);
  VectorXd product = at.tangent * d.reshaped();
  product += at.roots[0] * at.roots[0].dot(d.reshaped());
  const VectorXd difference = (force(kStep) - force(-kStep)) / (2 * kStep);
  EXPECT_LT((product - difference).norm(), kDifference * product.norm());
  EXPECT_GT((at.tangent * d.reshaped() - difference).norm(), 1e-2 * product.norm()) << "the root counts";
}

// With P (V_1 - V)/V_1 for its pressure, which pushes outward.
TEST_P(OnSurfaces, ABagPushesAsTheFollowerPressureThatItComesTo) {
  ElasticSolid bagged = box(2), pressed = box(2);
  const Faces faces = faces_of(bagged.faces());
  const double at_rest = volume_of(faces, bagged.X());
  ElasticLoads loads;
  loads.surface = {bag(bagged, 1.3)};
  bagged.assemble(kMaterial, ElasticLaw::NeoHookean, loads, rollers(bagged.X()));
  ASSERT_TRUE(bagged.solve().is_converged);
  const double V = volume_of(faces, bagged.X() + bagged.displacement()),
               pressure = 2e4 * (1 - V / 1.3 / at_rest);
  EXPECT_GT(V, 1.05 * at_rest);
  EXPECT_LT(V, 1.25 * at_rest);
  loads = {};
  loads.follower_pressure = [=](int) { return -pressure; };
  pressed.assemble(kMaterial, ElasticLaw::NeoHookean, loads, rollers(pressed.X()));
  ASSERT_TRUE(pressed.solve().is_converged);
  EXPECT_LT((pressed.displacement() - bagged.displacement()).norm(), 1e-7 * bagged.displacement().norm());
}

// Its rest lengths are history, as they relax where the surface was bent, and the target is that of the time.
TEST_P(OnSurfaces, AMotionInARelaxingSkinAndAChangingBagGoesOnFromItsState) {
  const auto motion_of = [](ElasticSolid& solid) {
    const Matrix3Xd& X = solid.X();
    const Eigen::Matrix3Xi F = flat_triangles(solid.faces());
    const Faces faces = faces_of(solid.faces());
    ElasticLoads loads;
    loads.surface = {std::make_shared<Membrane>(X, F, 1e3, 0.3, Relaxation{0.9, make_bending(X, F, 1)}),
                     std::make_shared<VolumePenalty>(
                         2e4, faces, TargetVolume{volume_of(faces, X), {{0, 1}, {0.1, 0.6}}, false})};
    solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, {});
    return GeneralisedAlpha(dynamics_of(solid), 0.01, kImplicitEuler);
  };
  ElasticSolid first = box(2), second = box(2);
  GeneralisedAlpha whole = motion_of(first), rest = motion_of(second);
  for (int n = 0; n < 4; ++n) ASSERT_TRUE(whole.step());
  const MotionState state = whole.state();
  ASSERT_EQ(state.surface.size(), 1u);
  for (int n = 0; n < 4; ++n) ASSERT_TRUE(whole.step());
  rest.set_state(state);
  for (int n = 0; n < 4; ++n) ASSERT_TRUE(rest.step());
  EXPECT_LT((rest.u() - whole.u()).norm(), 1e-7 * whole.u().norm());
  const VectorXd relaxed = state.surface[0]->rest_length, last = whole.state().surface[0]->rest_length;
  EXPECT_LT((rest.state().surface[0]->rest_length - last).norm(), 1e-7 * (relaxed - last).norm());
  EXPECT_LT(last.sum(), (1 - 1e-3) * relaxed.sum());
  const Faces faces = faces_of(first.faces());
  EXPECT_LT(volume_of(faces, first.X() + whole.u().reshaped(3, first.X().cols())),
            0.95 * volume_of(faces, first.X()));
}

// At small strain the energies of stitches are quadratic, so that a dense solve tells the displacement.
TEST_P(OnSurfaces, EntriesOutsideThePatternCountInStatics) {
  constexpr double kStiffness = 5e3, kSame = 1e-8;
  ElasticSolid solid = box(3);
  const Matrix3Xd X = solid.X();
  ElasticLoads loads;
  loads.body_force = [](const Vector3d& x) { return Vector3d(300 * x(1), 100, -500); };
  loads.surface = {seam_across(1.0 * X, kStiffness)};
  std::vector<ConstrainedComponent> clamp;  // of a face but for the corner where the seam ends
  for (int i = 0; i < X.cols(); ++i)
    for (int c = 0; c < 3 && X(0, i) == 0 && X(2, i) > 0; ++c) clamp.push_back({i, c, 0});
  solid.assemble(kMaterial, ElasticLaw::SmallStrain, loads, clamp);
  solid.set_tolerance(1e-12);
  const ElasticReport report = solid.solve();
  ASSERT_TRUE(report.is_converged);

  ElasticLoads alone = loads;
  alone.surface = {};
  ElasticSolid plain = box(3);
  plain.assemble(kMaterial, ElasticLaw::SmallStrain, alone, clamp);
  Eigen::MatrixXd K = plain.stiffness();
  VectorXd f = plain.load();
  int low, high;
  X.colwise().sum().minCoeff(&low);
  X.colwise().sum().maxCoeff(&high);
  const Vector3d way = kStiffness * (X.col(high) - X.col(low));
  for (int c = 0; c < 3; ++c) {
    K(3 * low + c, 3 * low + c) += kStiffness;
    K(3 * high + c, 3 * high + c) += kStiffness;
    K(3 * low + c, 3 * high + c) -= kStiffness;
    K(3 * high + c, 3 * low + c) -= kStiffness;
    f(3 * low + c) += way(c);
    f(3 * high + c) -= way(c);
  }
  for (const ConstrainedComponent& h : clamp) {
    const int k = 3 * h.node + h.component;
    K.row(k).setZero();
    K.col(k).setZero();
    K(k, k) = 1;
    f(k) = 0;
  }
  const VectorXd expected = K.partialPivLu().solve(f);
  EXPECT_LT((solid.displacement().reshaped() - expected).norm(), kSame * expected.norm());
  EXPECT_LT(report.newton_iterations, 6);
}

// The pressure of a bag is that of the law under an even stretch, whatever the body's shape.
TEST_P(OnSurfaces, ABagBlowsABoxUpAsAPressureDoes) {
  ElasticSolid solid = box(2);
  ElasticLoads loads;
  loads.surface = {bag(solid, 1.4)};
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, loads, rollers(solid.X()));
  ASSERT_TRUE(solid.solve().is_converged);
  const Faces faces = faces_of(solid.faces());
  const double J = volume_of(faces, solid.X() + solid.displacement()), s = std::cbrt(J);
  EXPECT_GT(J, 1.1);
  EXPECT_LT(largest_error(solid.X(), solid.displacement(),
                          [&](const Vector3d& x) -> Vector3d { return (s - 1) * x; }),
            1e-8);
  // The law's stress is the bag's pressure, P (V_1 - V) / V_1.
  const double mu = kMaterial.E / (2 * (1 + kMaterial.nu)),
               lambda = 2 * mu * kMaterial.nu / (1 - 2 * kMaterial.nu);
  const double traction = mu / s + lambda / 2 * J - (mu + lambda / 2) / J;
  EXPECT_NEAR(2e4 * (1.4 - J) / 1.4, traction, 1e-5 * traction);
}

/// A plate that comes down onto a box of height 1.
std::vector<RigidBody> plate(double by) {
  Obstacle obstacle;
  obstacle.shape = HalfSpace{{0, 0, 1 + 5e-4}, {0, 0, -1}};
  obstacle.motion = {{0, 0, 0, 0}, {1, 0, 0, -by}};
  return {RigidBody(obstacle)};
}

// Where a plate presses a box evenly, its strain is that of a box whose top is constrained where it came to lie.
TEST_P(OnSurfaces, APlateThatComesDownPressesABoxEvenly) {
  const std::vector<RigidBody> bodies = plate(0.3);
  ElasticSolid pressed = box(2), constrained = box(2);
  const Matrix3Xd X = pressed.X();
  ElasticLoads loads;
  loads.surface = {barrier_on_faces(pressed, bodies, 1e4)};
  std::vector<ConstrainedComponent> floor = rollers(X);
  pressed.assemble(kMaterial, ElasticLaw::NeoHookean, loads, floor);
  ElasticReport report;
  for (int n = 1; n <= 3; ++n) {
    report = pressed.solve(n / 3.);
    ASSERT_TRUE(report.is_converged) << n;
  }
  double top = 0;
  for (int i = 0; i < X.cols(); ++i)
    if (X(2, i) == 1) top = pressed.displacement()(2, i);
  EXPECT_NEAR(top, -0.3, 1e-3);
  std::vector<ConstrainedComponent> between = floor;
  for (int i = 0; i < X.cols(); ++i)
    if (X(2, i) == 1) between.push_back({i, 2, top});
  constrained.assemble(kMaterial, ElasticLaw::NeoHookean, {}, between);
  for (int n = 1; n <= 3; ++n) ASSERT_TRUE(constrained.solve(n / 3.).is_converged);
  EXPECT_LT((pressed.displacement() - constrained.displacement()).norm(),
            1e-6 * constrained.displacement().norm());
}

// Thrown at an angle onto a floor without friction it bounces and keeps its momentum along the floor.
TEST_P(OnSurfaces, AThrownBoxBouncesOffAFloorAndKeepsItsMomentumAlongIt) {
  Obstacle obstacle;
  obstacle.shape = HalfSpace{{0, 0, -0.02}, {0, 0, 1}};
  const std::vector<RigidBody> bodies{RigidBody(obstacle)};
  for (const ElasticLaw law : {ElasticLaw::NeoHookean, ElasticLaw::SmallStrain}) {
    ElasticSolid solid = box(2);
    const Matrix3Xd X = solid.X();
    ElasticLoads loads;
    loads.surface = {barrier_on_faces(solid, bodies, 1e3)};
    solid.assemble(kMaterial, law, loads, {});
    const Dynamics s = dynamics_of(solid);
    GeneralisedAlpha motion(s, 0.01, generalised_alpha(0));
    const VectorXd start = Vector3d(0.5, 0, -0.3).replicate(1, X.cols()).reshaped();
    motion.restart(VectorXd::Zero(start.size()), start);
    const auto momentum = [&](int c) { return momentum_of(s, motion.v(), c); };
    const double along = momentum(0), down = momentum(2), energy = motion.kinetic_energy();
    double lowest = 1, most = 0;
    for (int n = 0; n < 100; ++n) {
      ASSERT_TRUE(motion.step()) << n;
      lowest = std::min(lowest, (X + motion.u().reshaped(3, X.cols())).row(2).minCoeff());
      most = std::max(most, motion.kinetic_energy() + motion.elastic_energy());
    }
    EXPECT_LT(lowest, -0.015) << "it came there";
    EXPECT_GT(lowest, -0.05) << "corners are a sixth of a face from what stays above";
    EXPECT_NEAR(momentum(0), along, 1e-7 * along);
    EXPECT_GT(momentum(2), -0.5 * down) << "and up again";
    EXPECT_LT(most, 1.05 * energy);
  }
}

}  // namespace
}  // namespace testbed::fem
