// Vibrations and steps in time against exact motions of the discrete system.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <numeric>

#include "fem_reference/solid/dynamics.h"
#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solid/natural_modes.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Vector3d;
using Eigen::VectorXd;

const Material kMaterial{1000, 0.3, 1, 0};

struct Bar {
  ElasticSolid solid;
  std::vector<int> constrained;
  ElasticLaw law;
  explicit Bar(ElasticLaw law = ElasticLaw::SmallStrain, int degree = 2)
      : solid(box_tets(4, 1, 1, 0.5, 0), degree), law(law) {
    ElasticLoads gravity;
    gravity.body_force = [](const Vector3d&) { return Vector3d(0, -1, 0); };
    std::vector<ConstrainedComponent> clamp;
    for (int i = 0; i < solid.X().cols(); ++i)
      for (int c = 0; c < 3 && solid.X()(0, i) == 0; ++c) {
        clamp.push_back({i, c, 0});
        constrained.push_back(3 * i + c);
      }
    solid.assemble(kMaterial, law, gravity, clamp);
  }
  /// Without load.
  Dynamics system() const {
    Dynamics s{solid.stiffness(), solid.mass(), 0, 0, VectorXd::Zero(solid.n_dofs()), constrained, {}, {}};
    if (law != ElasticLaw::SmallStrain)
      s.linearise = [this](const VectorXd& u, bool with_tangent) {
        return solid.linearise(u.reshaped(3, solid.X().cols()), 1, with_tangent);
      };
    s.X = solid.X();
    return s;
  }
};

TEST(NaturalModes, SatisfyTheirEquation) {
  const Bar bar;
  const Dynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, s.constrained, 6);
  EXPECT_EQ(modes.n_rigid, 0);
  const Eigen::MatrixXd orthonormal = modes.shape.transpose() * s.M * modes.shape;
  EXPECT_LT((orthonormal - Eigen::MatrixXd::Identity(6, 6)).norm(), 1e-10);
  for (int k = 0; k < 6; ++k) {
    const double w = 2 * M_PI * modes.frequency(k);
    VectorXd residual = s.K * modes.shape.col(k) - w * w * (s.M * modes.shape.col(k));
    residual(s.constrained).setZero();
    EXPECT_LT(residual.norm(), 1e-7 * (s.K * modes.shape.col(k)).norm()) << k;
  }
}

TEST(NaturalModes, OfAFreeBodyLieBesideSixRigidMotions) {
  const Bar bar;
  const Dynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, {}, 8);
  EXPECT_EQ(modes.n_rigid, 6);
  ASSERT_EQ(modes.frequency.size(), 8);
  EXPECT_GT(modes.frequency(0), 0);
}

/// Largest distance from the exact motion of the first mode over two periods, damped to `damping` of what is
/// critical by mass and by stiffness alike.
double error_of(const Bar& bar, const TimeScheme& scheme, int steps_per_period, double damping) {
  Dynamics s = bar.system();
  const Modes modes = natural_modes(s.K, s.M, s.constrained, 1);
  const double w = 2 * M_PI * modes.frequency(0), damped = w * std::sqrt(1 - damping * damping);
  s.damping = damping * w;
  s.stiffness_damping = damping / w;
  GeneralisedAlpha motion(s, 2 * M_PI / w / steps_per_period, scheme);
  motion.restart(modes.shape.col(0), VectorXd::Zero(modes.shape.rows()));
  double error = 0;
  for (int n = 1; n <= 2 * steps_per_period; ++n) {
    motion.step();
    const double t = 2 * M_PI / w * n / steps_per_period;
    const double exact =
        std::exp(-damping * w * t) * (std::cos(damped * t) + damping * w / damped * std::sin(damped * t));
    error = std::max(error, (motion.u() - exact * modes.shape.col(0)).norm() / modes.shape.col(0).norm());
  }
  return error;
}

TEST(GeneralisedAlpha, IsOfSecondOrder) {
  const Bar bar;
  for (const TimeScheme& scheme : {kNewmark, generalised_alpha(0.5)})
    for (double damping : {0.0, 0.2}) {
      const double fine = error_of(bar, scheme, 80, damping);
      EXPECT_LT(fine, 0.02);
      EXPECT_NEAR(std::log2(error_of(bar, scheme, 40, damping) / fine), 2, 0.1);
    }
}

// Its three unknowns of a step at once, as the method's equations stand in the paper.
TEST(GeneralisedAlpha, MovesADampedOscillatorByTheSchemesRecurrence) {
  constexpr double m = 2, k = 50, c = 3, h = 0.1, f = 7, kStart = 0.4, kSpeed = -1, kRounding = 1e-12;
  const auto scalar = [](double value) {
    Eigen::SparseMatrix<double> A(1, 1);
    A.insert(0, 0) = value;
    return A;
  };
  for (bool is_by_stiffness : {false, true})
    for (const TimeScheme& scheme :
         {kNewmark, generalised_alpha(0.8), generalised_alpha(0.3), kImplicitEuler}) {
      const auto& [alpha_m, alpha_f, beta, gamma, early] = scheme;
      Dynamics s{scalar(k), scalar(m), 0, 0, VectorXd::Constant(1, f), {}, {}, {}};
      (is_by_stiffness ? s.stiffness_damping : s.damping) = c / (is_by_stiffness ? k : m);
      GeneralisedAlpha motion(s, h, scheme);
      motion.restart(VectorXd::Constant(1, kStart), VectorXd::Constant(1, kSpeed));
      Eigen::Matrix3d A, B;  // A (u, v, a) = B (u, v, a)_before + (f, 0, 0)
      A << k * (1 - alpha_f), c * (1 - alpha_f), m * (1 - alpha_m),  //
          1, 0, -h * h * beta,                                       //
          0, 1, -h * gamma;
      B << -k * alpha_f, -c * alpha_f, -m * alpha_m,    //
          1, h, h * h * (gamma == 1 ? 0 : 0.5 - beta),  //
          0, 1, h * (1 - gamma);
      Vector3d x(kStart, kSpeed, (f - c * kSpeed - k * kStart) / m);
      for (int n = 0; n < 30; ++n) {
        ASSERT_TRUE(motion.step());
        x = A.inverse() * (B * x + Vector3d(f, 0, 0));
        EXPECT_NEAR(motion.u()(0), x(0), kRounding);
        EXPECT_NEAR(motion.v()(0), x(1), kRounding);
      }
    }
}

TEST(GeneralisedAlpha, RestartsItsClock) {
  constexpr double h = 0.05;
  const Bar bar;
  Dynamics s = bar.system();
  s.constrained_motion = [n = bar.constrained.size()](double t) -> VectorXd {
    return VectorXd::Constant(static_cast<Eigen::Index>(n), 0.3 * t);
  };
  GeneralisedAlpha motion(s, h, kNewmark);
  for (int n = 0; n < 7; ++n) motion.step();
  motion.restart(VectorXd::Zero(bar.solid.n_dofs()), VectorXd::Zero(bar.solid.n_dofs()));
  EXPECT_EQ(motion.t(), 0);
  EXPECT_EQ(motion.u()(s.constrained).cwiseAbs().maxCoeff(), 0);
  for (int n = 0; n < 4; ++n) motion.step();
  EXPECT_NEAR(motion.t(), 4 * h, 1e-15);
  EXPECT_LT((motion.u()(s.constrained).array() - 0.3 * 4 * h).abs().maxCoeff(), 1e-15);
}

TEST(GeneralisedAlpha, NewmarkConservesEnergy) {
  constexpr double kDrift = 1e-10;
  const Bar bar;
  Dynamics s = bar.system();
  VectorXd start = VectorXd::Zero(bar.solid.n_dofs());
  for (int i = 0; i < bar.solid.X().cols(); ++i) start(3 * i + 1) = std::pow(bar.solid.X()(0, i), 2);
  GeneralisedAlpha motion(std::move(s), 0.01, kNewmark);
  motion.restart(VectorXd::Zero(start.size()), start);
  const double energy = motion.kinetic_energy();
  double least_kinetic = energy;
  for (int n = 0; n < 1000; ++n) {
    motion.step();
    EXPECT_NEAR(motion.kinetic_energy() + motion.elastic_energy(), energy, kDrift * energy);
    least_kinetic = std::min(least_kinetic, motion.kinetic_energy());
  }
  EXPECT_LT(least_kinetic, 0.1 * energy);  // it swung
}

// Of motions much faster than the step, n steps leave rho^n, which a triple root makes (a + b n + c n^2)
// rho^n.
TEST(GeneralisedAlpha, DampsTheHighestMotionsAsItSays) {
  constexpr int kSteps = 20;
  const Bar bar;
  VectorXd start = VectorXd::Random(bar.solid.n_dofs());
  start(bar.constrained).setZero();
  const auto left_by_half = [&](const TimeScheme& scheme) {
    GeneralisedAlpha motion(bar.system(), 100, scheme);  // the slowest period is 1.6 s
    motion.restart(start, VectorXd::Zero(start.size()));
    for (int n = 0; n < kSteps; ++n) motion.step();
    const double before = motion.u().norm();
    for (int n = 0; n < kSteps; ++n) motion.step();
    return motion.u().norm() / before;
  };
  EXPECT_NEAR(left_by_half(kNewmark), 1, 0.01);
  for (double rho : {0.5, 0.8}) {
    const double left = left_by_half(generalised_alpha(rho));
    EXPECT_GE(left, 0.5 * std::pow(rho, kSteps));
    EXPECT_LE(left, 8 * std::pow(rho, kSteps));
  }
}

TEST(GeneralisedAlpha, DampedMotionEndsAtEquilibrium) {
  Bar bar;
  bar.solid.solve();
  Dynamics s = bar.system();
  s.load = bar.solid.load();
  const Modes modes = natural_modes(s.K, s.M, s.constrained, 1);
  s.damping = 4 * M_PI * modes.frequency(0);  // critical for the first mode
  GeneralisedAlpha motion(std::move(s), 0.02 / modes.frequency(0), kNewmark);
  for (int n = 0; n < 400; ++n) motion.step();
  const VectorXd rest = bar.solid.displacement().reshaped();
  EXPECT_LT((motion.u() - rest).norm(),
            1e-5 * rest.norm());  // what is left is of the highest modes, which long steps damp least
}

TEST(GeneralisedAlpha, MovesConstrainedUnknownsAsPrescribed) {
  const Bar bar;
  Dynamics s = bar.system();
  s.constrained_motion = [n = bar.constrained.size()](double t) -> VectorXd {
    return VectorXd::Constant(static_cast<Eigen::Index>(n), 0.3 * t + 0.2 * t * t);
  };
  GeneralisedAlpha motion(s, 0.05, kNewmark);
  for (int n = 0; n < 20; ++n) motion.step();
  EXPECT_LT((motion.u()(s.constrained).array() - 0.5).abs().maxCoeff(), 1e-12);  // at t = 1
  EXPECT_LT((motion.v()(s.constrained).array() - 0.7).abs().maxCoeff(), 1e-12);
}

TEST(GeneralisedAlpha, MovesABodyThatIsConstrainedEverywhere) {
  for (ElasticLaw law : {ElasticLaw::SmallStrain, ElasticLaw::NeoHookean}) {
    const Bar bar(law);
    Dynamics s = bar.system();
    s.constrained.resize(bar.solid.n_dofs());
    std::iota(s.constrained.begin(), s.constrained.end(), 0);
    s.constrained_motion = [n = bar.solid.n_dofs()](double t) -> VectorXd {
      return VectorXd::Constant(n, 0.3 * t);
    };
    GeneralisedAlpha motion(s, 0.05, kNewmark);
    for (int n = 0; n < 20; ++n) ASSERT_TRUE(motion.step());
    EXPECT_LT((motion.u().array() - 0.3).abs().maxCoeff(), 1e-12);
    EXPECT_LT((motion.v().array() - 0.3).abs().maxCoeff(), 1e-12);
  }
}

// Seen from a clamp that accelerates evenly, a body is under its own weight the other way.
TEST(GeneralisedAlpha, TakesAnAcceleratedClampForWeight) {
  constexpr double kAcceleration = 3, kNewton = 1e-6;  // each step stops at 1e-9 of the forces
  for (ElasticLaw law : {ElasticLaw::SmallStrain, ElasticLaw::NeoHookean})
    for (const TimeScheme& scheme : {kNewmark, generalised_alpha(0.5)}) {
      const Bar bar(law);
      Dynamics weighed = bar.system(), moved = weighed;
      VectorXd along = VectorXd::Zero(bar.solid.n_dofs());
      for (int k = 1; k < along.size(); k += 3) along(k) = kAcceleration;
      weighed.load = -weighed.M * along;
      const auto travel = [](double t) { return t * t / 2; };
      moved.constrained_motion = [&](double t) -> VectorXd { return travel(t) * along(bar.constrained); };
      GeneralisedAlpha inside(weighed, 0.05, scheme), outside(moved, 0.05, scheme);
      double largest = 0, error = 0;
      for (int n = 0; n < 40; ++n) {
        ASSERT_TRUE(inside.step() && outside.step());
        largest = std::max(largest, inside.u().lpNorm<Eigen::Infinity>());
        error = std::max(error,
                         (outside.u() - travel(outside.t()) * along - inside.u()).lpNorm<Eigen::Infinity>());
      }
      EXPECT_GT(largest, 0.1);
      EXPECT_LT(error, (law == ElasticLaw::SmallStrain ? 1e-11 : kNewton) * largest);
    }
}

/// Under `weight` times its gravity.
Dynamics let_go(const Bar& bar, double weight) {
  Dynamics s = bar.system();
  s.load = weight * bar.solid.load();
  return s;
}

TEST(GeneralisedAlpha, AtFiniteStrainTendsToSmallStrainWithTheLoad) {
  const Bar bar(ElasticLaw::NeoHookean), linear;
  const auto motion = [](const Bar& body, double weight) {
    GeneralisedAlpha steps(let_go(body, weight), 0.02, kNewmark);
    VectorXd path(40 * body.solid.n_dofs());
    for (int n = 0; n < 40; ++n) {
      EXPECT_TRUE(steps.step());
      path.segment(n * steps.u().size(), steps.u().size()) = steps.u() / weight;
    }
    return path;
  };
  const VectorXd small = motion(linear, 1);
  const double large = (motion(bar, 0.2) - small).norm() / small.norm(),
               little = (motion(bar, 0.1) - small).norm() / small.norm();
  EXPECT_LT(little, 0.01);
  EXPECT_GT(little, 1e-6);
  EXPECT_NEAR(std::log2(large / little), 1, 0.2);  // the first non-linear term is quadratic in the load
}

TEST(GeneralisedAlpha, EndsAStepAtTheToleranceThatIsAskedFor) {
  const Bar bar(ElasticLaw::NeoHookean);
  const auto end = [&](double tolerance, int& n_iterations) {
    Dynamics s = let_go(bar, 8);
    s.tolerance = tolerance;
    GeneralisedAlpha motion(s, 0.02, kNewmark);
    for (int n = 0; n < 20; ++n) EXPECT_TRUE(motion.step());
    n_iterations = motion.counts().newton_iterations;
    return motion.u();
  };
  constexpr double kLoose = 1e-4;
  int n_loose, n_tight;
  const VectorXd loose = end(kLoose, n_loose), tight = end(1e-10, n_tight);
  EXPECT_LT(1.5 * n_loose, n_tight);
  const double difference = (loose - tight).norm() / tight.norm();
  EXPECT_LT(difference, 10 * kLoose);
  EXPECT_GT(difference, 1e-3 * kLoose);
}

// On few elements, so that a step resolves the fastest of their motions.
TEST(GeneralisedAlpha, AtFiniteStrainIsOfSecondOrder) {
  const Bar bar(ElasticLaw::NeoHookean, 1);
  for (const TimeScheme& scheme : {kNewmark, generalised_alpha(0.5)}) {
    const auto end = [&](int n_steps) {
      GeneralisedAlpha motion(let_go(bar, 400), 0.06 / n_steps, scheme);
      for (int n = 0; n < n_steps; ++n) EXPECT_TRUE(motion.step());
      return motion.u();
    };
    const VectorXd finest = end(800);
    const double coarse = (end(50) - finest).norm(), fine = (end(100) - finest).norm();
    EXPECT_GT(finest.lpNorm<Eigen::Infinity>(), 0.5);  // of a bar of length 2
    EXPECT_LT(fine, 1e-3 * finest.norm());
    EXPECT_NEAR(std::log2(coarse / fine), 2, 0.1);
  }
}

// What the load has done is in the body's motion and strain; average acceleration keeps that budget to second
// order.
TEST(GeneralisedAlpha, AtFiniteStrainKeepsTheEnergyBudgetToSecondOrder) {
  const Bar bar(ElasticLaw::NeoHookean);
  const auto largest_gap = [&](int n_steps) {
    const Dynamics s = let_go(bar, 8);
    GeneralisedAlpha motion(s, 1.0 / n_steps, kNewmark);
    double gap = 0, work = 0;
    for (int n = 0; n < n_steps; ++n) {
      EXPECT_TRUE(motion.step());
      work = std::max(work, s.load.dot(motion.u()));
      gap =
          std::max(gap, std::abs(motion.kinetic_energy() + motion.elastic_energy() - s.load.dot(motion.u())));
    }
    return gap / work;
  };
  const double coarse = largest_gap(80), fine = largest_gap(160);
  EXPECT_LT(fine, 1e-3);
  EXPECT_NEAR(std::log2(coarse / fine), 2, 0.3);
}

// A bar turns three times about its shortest axis, stretched by what pulls it outward.
TEST(GeneralisedAlpha, SpinsFreeBodiesAndKeepsTheirEnergyAndMomentumToSecondOrder) {
  constexpr double kTurn = 3;  // rad/s
  ElasticSolid solid(box_tets(4, 2, 1, 0.5, 0), 2);
  solid.assemble(kMaterial, ElasticLaw::NeoHookean, {}, {});
  const Eigen::Matrix3Xd& X = solid.X();
  const Vector3d centre = (X.rowwise().maxCoeff() + X.rowwise().minCoeff()) / 2;
  VectorXd start(solid.n_dofs());
  for (int i = 0; i < X.cols(); ++i)
    start.segment<3>(3 * i) = kTurn * Vector3d::UnitZ().cross(X.col(i) - centre);
  const auto drifts = [&](int n_steps) {
    Dynamics s{solid.stiffness(), solid.mass(), 0, 0, VectorXd::Zero(solid.n_dofs()), {}, {}, {}};
    s.linearise = [&](const VectorXd& u, bool with_tangent) {
      return solid.linearise(u.reshaped(3, X.cols()), 1, with_tangent);
    };
    s.X = X;
    GeneralisedAlpha motion(s, 6 * M_PI / kTurn / n_steps, kNewmark);
    motion.restart(VectorXd::Zero(start.size()), start);
    const auto momentum = [&] {
      const VectorXd p = s.M * motion.v();
      Vector3d L = Vector3d::Zero();
      for (int i = 0; i < X.cols(); ++i)
        L += (X.col(i) + motion.u().segment<3>(3 * i) - centre).cross(p.segment<3>(3 * i));
      return L;
    };
    const double energy = motion.kinetic_energy();
    const Vector3d L = momentum();
    Eigen::Array2d drift = Eigen::Array2d::Zero();
    double most_strained = 0;
    for (int n = 0; n < n_steps; ++n) {
      EXPECT_TRUE(motion.step());
      const double elastic = motion.elastic_energy();
      drift = drift.max(Eigen::Array2d(std::abs(motion.kinetic_energy() + elastic - energy) / energy,
                                       (momentum() - L).norm() / L.norm()));
      most_strained = std::max(most_strained, elastic / energy);
    }
    EXPECT_GT(most_strained, 1e-3);
    return drift;
  };
  const Eigen::Array2d coarse = drifts(400), fine = drifts(800);
  EXPECT_LT(fine.maxCoeff(), 1e-2);
  EXPECT_GT(fine.minCoeff(), 1e-9);
  for (int k = 0; k < 2; ++k) EXPECT_NEAR(std::log2(coarse(k) / fine(k)), 2, 0.2) << coarse << '\n' << fine;
}

TEST(GeneralisedAlpha, SaysWhenAStepHasNoSolutionAndStays) {
  const Bar bar(ElasticLaw::NeoHookean);
  Dynamics s = bar.system();
  s.constrained_motion = [&](double t) -> VectorXd {  // the clamp runs through the bar within a step
    VectorXd u = VectorXd::Zero(static_cast<Eigen::Index>(bar.constrained.size()));
    for (Eigen::Index k = 0; k < u.size(); k += 3) u(k) = t > 0 ? 5 : 0;
    return u;
  };
  GeneralisedAlpha motion(s, 0.1, kNewmark);
  EXPECT_FALSE(motion.step());
  EXPECT_EQ(motion.t(), 0);
  EXPECT_EQ(motion.u().norm(), 0);
}

/// First frequency (Hz) along a free bar that cannot move sideways, over c / (2 L).
double frequency_along(int degree, MassMatrix kind, int n) {
  constexpr double L = 2;
  ElasticSolid solid(box_tets(n, n / 4, n / 4, L / n), degree);
  solid.assemble(kMaterial, ElasticLaw::SmallStrain, {}, {});
  std::vector<int> constrained;
  for (int k = 0; k < solid.n_dofs(); ++k)
    if (k % 3 != 0) constrained.push_back(k);
  const Eigen::SparseMatrix<double> M = solid.mass(kind);
  EXPECT_NEAR(M.sum(), 3 * kMaterial.rho * L / 4, 1e-12);
  EXPECT_EQ(M.nonZeros() == M.rows(), kind == MassMatrix::Lumped);
  EXPECT_GT(M.diagonal().minCoeff(), 0);
  const Modes modes = natural_modes(solid.stiffness(), M, constrained, 1);
  const double nu = kMaterial.nu, c2 = kMaterial.E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / kMaterial.rho;
  return modes.frequency(0) / (std::sqrt(c2) / (2 * L));
}

// No consistent mass makes a frequency too low [Rayleigh]. Lumped, both degrees are of second order.
TEST(NaturalModes, ALumpedMassLowersThem) {
  for (int degree : {1, 2}) {
    EXPECT_GT(frequency_along(degree, MassMatrix::Consistent, 4), 1);
    const int n = 8 / degree;
    const double coarse = frequency_along(degree, MassMatrix::Lumped, n) - 1,
                 fine = frequency_along(degree, MassMatrix::Lumped, 2 * n) - 1;
    EXPECT_LT(coarse, 0);
    EXPECT_NEAR(std::log2(coarse / fine), 2, 0.3);
  }
}

}  // namespace
}  // namespace testbed::fem
