// Explicit steps against exact motions of the discrete system, and against the implicit ones.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>

#include "fem_reference/solid/central_differences.h"
#include "fem_reference/solid/natural_modes.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

const Material kMaterial{1000, 0.3, 1, 0};

/// A bar of 2 m x 0.5 m x 0.5 m under gravity, clamped at x = 0 unless it is free.
struct Bar {
  ElasticSolid solid;
  ElasticLaw law;
  std::vector<int> constrained;
  Bar(ElasticLaw law, int degree, bool is_free = false) : solid(box_tets(4, 1, 1, 0.5), degree), law(law) {
    ElasticLoads gravity;
    if (!is_free) gravity.body_force = [](const Vector3d&) { return Vector3d(0, -1, 0); };
    std::vector<ConstrainedComponent> clamp;
    for (int i = 0; i < solid.X().cols() && !is_free; ++i)
      for (int c = 0; c < 3 && solid.X()(0, i) == 0; ++c) {
        clamp.push_back({i, c, 0});
        constrained.push_back(3 * i + c);
      }
    solid.assemble(kMaterial, law, gravity, clamp);
  }
  Dynamics system() const {
    Dynamics s{solid.stiffness(), solid.mass(MassMatrix::Lumped), 0, 0, solid.load(), constrained, {}, {}};
    s.X = solid.X();
    if (law != ElasticLaw::SmallStrain)
      s.linearise = [this](const VectorXd& u, bool with_tangent) {
        return solid.linearise(u.reshaped(3, solid.X().cols()), 1, with_tangent);
      };
    s.forces = [this](const VectorXd& u, Matrix3Xd& f) {
      solid.find_forces(u.reshaped(3, solid.X().cols()), 1, f);
    };
    return s;
  }
};

class CentralDifferencesOf : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Degree, CentralDifferencesOf, testing::Values(1, 2));

/// Highest frequency (rad/s) of what is free, by dense matrices.
double highest_frequency(const Dynamics& s) {
  std::vector<int> free;
  for (int k = 0; k < s.K.rows(); ++k)
    if (std::find(s.constrained.begin(), s.constrained.end(), k) == s.constrained.end()) free.push_back(k);
  const MatrixXd K = MatrixXd(s.K)(free, free), M = MatrixXd(s.M)(free, free);
  return std::sqrt(Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd>(K, M, Eigen::EigenvaluesOnly)
                       .eigenvalues()
                       .maxCoeff());
}

TEST_P(CentralDifferencesOf, StableStepIsTwoOverTheHighestFrequency) {
  for (const bool is_free : {false, true}) {
    const Dynamics s = Bar(ElasticLaw::SmallStrain, GetParam(), is_free).system();
    EXPECT_GT(s.M.diagonal().minCoeff(), 0);
    EXPECT_NEAR(s.M.diagonal().sum() / 3, 0.5, 1e-12) << "the bar's mass";
    const double limit = 2 / highest_frequency(s), found = stable_step(s);
    EXPECT_LE(found, limit * (1 + 1e-12));
    EXPECT_GT(found, 0.995 * limit);
  }
}

TEST_P(CentralDifferencesOf, StepsAreBoundedBelowTheStableOneAndDivergeBeyond) {
  const Bar bar(ElasticLaw::SmallStrain, GetParam());
  const double limit = 2 / highest_frequency(bar.system());
  for (const double factor : {0.99, 1.01}) {
    CentralDifferences motion(bar.system(), factor * limit);
    VectorXd v = VectorXd::LinSpaced(bar.solid.n_dofs(), -1, 1).array().cube();
    motion.restart(VectorXd::Zero(v.size()), v);
    bool is_sound = true;
    for (int n = 0; n < 3000 && is_sound; ++n) is_sound = motion.step();
    EXPECT_EQ(is_sound, factor < 1);
    if (is_sound) {
      EXPECT_LT(motion.v().norm(), 100 * v.norm());
    }
  }
}

// A mode moves by cos(n theta), sin(theta / 2) = w h / 2: the scheme's own dispersion. Its period is that of
// the bar in the limit of short steps.
TEST_P(CentralDifferencesOf, ModeOfABarHasThePeriodOfTheScheme) {
  const Bar bar(ElasticLaw::SmallStrain, GetParam());
  Dynamics s = bar.system();
  s.load.setZero();
  const Modes modes = natural_modes(s.K, s.M, s.constrained, 2);
  for (int k = 0; k < 2; ++k) {
    const double w = 2 * M_PI * modes.frequency(k), h = 0.9 * stable_step(s);
    CentralDifferences motion(s, h);
    motion.restart(modes.shape.col(k), VectorXd::Zero(s.load.size()));
    const double theta = 2 * std::asin(w * h / 2);
    for (int n = 1; n <= 1000; ++n) {
      ASSERT_TRUE(motion.step());
      if (n % 100 > 0) continue;
      EXPECT_LT((motion.u() - std::cos(n * theta) * modes.shape.col(k)).norm(),
                1e-6 * modes.shape.col(k).norm())
          << n;
    }
  }
}

TEST(CentralDifferences, MoveADampedOscillatorByTheSchemesRecurrence) {
  constexpr double m = 2, k = 50, c = 3, h = 0.1, f = 7, kStart = 0.4, kSpeed = -1;
  const auto diagonal = [](double value) {
    Eigen::SparseMatrix<double> A(3, 3);
    A.setIdentity();
    return Eigen::SparseMatrix<double>(value * A);
  };
  CentralDifferences motion({diagonal(k), diagonal(m), c, 0, VectorXd::Constant(3, f), {}, {}, {}}, h);
  motion.restart(VectorXd::Constant(3, kStart), VectorXd::Constant(3, kSpeed));
  const double a = (f - k * kStart) / m - c * kSpeed;
  double before = kStart - h * kSpeed + h * h / 2 * a, now = kStart;  // m (u1 - 2 u0 + u-1) / h2 + ... = f
  for (int n = 0; n < 20; ++n) {
    const double after = (f - k * now + m * (2 * now - before) / (h * h) + m * c * before / (2 * h)) /
                         (m / (h * h) + m * c / (2 * h));
    ASSERT_TRUE(motion.step());
    EXPECT_NEAR(motion.u()(1), after, 1e-12);
    before = now;
    now = after;
  }
}

/// Largest distance from a motion of the implicit scheme in very short steps, over the largest displacement.
double error_of(const Bar& bar, double h, double end) {
  CentralDifferences motion(bar.system(), h);
  constexpr int kFiner = 8;
  GeneralisedAlpha exact(bar.system(), h / kFiner, kNewmark);
  double error = 0, size = 0;
  while (motion.t() < end) {
    EXPECT_TRUE(motion.step());
    for (int n = 0; n < kFiner; ++n) EXPECT_TRUE(exact.step());
    error = std::max(error, (motion.u() - exact.u()).norm());
    size = std::max(size, exact.u().norm());
  }
  return error / size;
}

TEST_P(CentralDifferencesOf, ConvergeToTheImplicitMotionAsTheSquareOfTheStep) {
  for (const ElasticLaw law : {ElasticLaw::SmallStrain, ElasticLaw::NeoHookean}) {
    const Bar bar(law, GetParam());
    const double h = 0.2 * stable_step(bar.system()), end = 150 * h;
    const double coarse = error_of(bar, h, end), fine = error_of(bar, h / 2, end);
    EXPECT_LT(fine, 2e-3);
    EXPECT_NEAR(std::log2(coarse / fine), 2, 0.15);
  }
}

TEST_P(CentralDifferencesOf, EnergyOfAFreeVibrationDoesNotDrift) {
  for (const ElasticLaw law : {ElasticLaw::SmallStrain, ElasticLaw::NeoHookean}) {
    const Bar bar(law, GetParam());
    Dynamics s = bar.system();
    const VectorXd load = s.load;
    CentralDifferences motion(s, 0.5 * stable_step(s));
    const auto energy = [&] {
      return motion.kinetic_energy() + motion.elastic_energy() - load.dot(motion.u());
    };
    double most = 0, late = 0, swing = 0;  // of the energy, which is 0 at the start
    for (int n = 0; n < 4000; ++n) {
      ASSERT_TRUE(motion.step());
      swing = std::max(swing, motion.kinetic_energy());
      (n < 2000 ? most : late) = std::max(n < 2000 ? most : late, std::abs(energy()));
    }
    EXPECT_LT(late, 1.5 * most + 1e-3 * swing);
    EXPECT_LT(late, 0.05 * swing);
  }
}

TEST_P(CentralDifferencesOf, AFreeBodyThatSpinsKeepsItsAngularMomentum) {
  const Bar bar(ElasticLaw::NeoHookean, GetParam(), true);
  const Matrix3Xd& X = bar.solid.X();
  Matrix3Xd v(3, X.cols());
  for (int i = 0; i < X.cols(); ++i) v.col(i) = Vector3d(1, 2, -3).cross(X.col(i) - Vector3d(1, 0.25, 0.25));
  const Dynamics s = bar.system();
  CentralDifferences motion(s, 0.5 * stable_step(s));
  motion.restart(VectorXd::Zero(v.size()), v.reshaped());
  const auto momentum = [&] {
    const VectorXd p = s.M * motion.v();
    Vector3d sum = Vector3d::Zero();
    for (int i = 0; i < X.cols(); ++i)
      sum += (X.col(i) + motion.u().segment<3>(3 * i)).cross(p.segment<3>(3 * i));
    return sum;
  };
  const Vector3d before = momentum();
  for (int n = 0; n < 500; ++n) ASSERT_TRUE(motion.step());
  EXPECT_GT(motion.u().norm(), 0.5 * X.norm()) << "it has turned far";
  EXPECT_LT((momentum() - before).norm(), 1e-11 * before.norm());
}

TEST(CentralDifferences, ConstrainedUnknownsMoveAsPrescribed) {
  const Bar bar(ElasticLaw::SmallStrain, 1);
  Dynamics s = bar.system();
  const auto at = [](double t) { return 0.1 * std::sin(t); };
  s.constrained_motion = [&](double t) {
    return VectorXd::Constant(static_cast<int>(bar.constrained.size()), at(t)).eval();
  };
  const double h = 0.5 * stable_step(s);
  CentralDifferences motion(s, h);
  for (int n = 0; n < 50; ++n) ASSERT_TRUE(motion.step());
  for (const int k : bar.constrained) {
    EXPECT_EQ(motion.u()(k), at(motion.t()));
    EXPECT_NEAR(motion.v()(k), 0.1 * std::cos(motion.t()), h * h);
  }
}

TEST(CentralDifferences, ABodyTurnedInsideOutHasNoMotion) {
  const Bar bar(ElasticLaw::NeoHookean, 1, true);
  const Dynamics s = bar.system();
  CentralDifferences motion(s, stable_step(s) / 2);
  const Matrix3Xd mirrored = -2 * bar.solid.X();
  motion.restart(mirrored.reshaped(), VectorXd::Zero(mirrored.size()));
  EXPECT_FALSE(motion.step());
}

}  // namespace
}  // namespace testbed::fem
