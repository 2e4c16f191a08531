#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>

#include "tests/fem_reference/respond.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

const ElasticLaw kLaws[] = {ElasticLaw::SmallStrain, ElasticLaw::StVenantKirchhoff, ElasticLaw::NeoHookean};
const ElasticLaw kFiniteLaws[] = {ElasticLaw::StVenantKirchhoff, ElasticLaw::NeoHookean};
constexpr double kShrinkage = 0.1;

const LameConstants& lame() {
  static const LameConstants kConstants(Material{1000, 0.3, 1, 0});
  return kConstants;
}

const Matrix3d& deformation() {
  static const Matrix3d F = (Matrix3d() << 1.2, .1, -.2, .05, .8, .15, -.1, .2, 1.1).finished();
  return F;
}

TEST(Laws, StressIsGradientOfEnergy) {
  constexpr double h = 1e-5, kTolerance = 1e-5;  // central difference of terms of order 1e3
  for (ElasticLaw law : kLaws) {
    const Matrix3d P = respond(law, lame(), deformation(), kShrinkage).P;
    EXPECT_GT(P.norm(), 1);
    for (int k = 0; k < 9; ++k) {
      Matrix3d plus = deformation(), minus = plus;
      plus(k) += h;
      minus(k) -= h;
      const double slope =
          (respond(law, lame(), plus, kShrinkage).energy - respond(law, lame(), minus, kShrinkage).energy) /
          (2 * h);
      EXPECT_NEAR(P(k), slope, kTolerance * P.norm());
    }
  }
}

TEST(Laws, TangentIsGradientOfStressAndSymmetric) {
  constexpr double h = 1e-5, kTolerance = 1e-6;
  for (ElasticLaw law : kLaws) {
    const ElasticResponse r = respond(law, lame(), deformation(), kShrinkage);
    for (int k = 0; k < 9; ++k) {
      Matrix3d plus = deformation(), minus = plus;
      plus(k) += h;
      minus(k) -= h;
      const Matrix3d slope =
          (respond(law, lame(), plus, kShrinkage).P - respond(law, lame(), minus, kShrinkage).P) / (2 * h);
      EXPECT_LT((r.C.col(k) - slope.reshaped()).norm(), kTolerance * r.C.norm());
    }
    EXPECT_LT((r.C - r.C.transpose()).norm(), 1e-12 * r.C.norm());
  }
}

TEST(Laws, LocalVolumeIsThatOfTheWholeDeformationAndHasItsDerivatives) {
  constexpr double h = 1e-5, kKappa = 700, kTolerance = 1e-6;
  LameConstants with = lame();
  with.kappa = kKappa;
  const auto added = [&](const Matrix3d& F) {
    ElasticResponse r = respond(ElasticLaw::NeoHookean, with, F, kShrinkage);
    const ElasticResponse plain = respond(ElasticLaw::NeoHookean, lame(), F, kShrinkage);
    r.energy -= plain.energy;
    r.P -= plain.P;
    r.C -= plain.C;
    return r;
  };
  const ElasticResponse r = added(deformation());
  EXPECT_NEAR(r.energy, kKappa / 2 * std::pow(deformation().determinant() - 1, 2), 1e-12 * kKappa);
  for (int k = 0; k < 9; ++k) {
    Matrix3d plus = deformation(), minus = plus;
    plus(k) += h;
    minus(k) -= h;
    EXPECT_NEAR(r.P(k), (added(plus).energy - added(minus).energy) / (2 * h), kTolerance * kKappa);
    EXPECT_LT((r.C.col(k) - ((added(plus).P - added(minus).P) / (2 * h)).reshaped()).norm(),
              kTolerance * r.C.norm());
  }
}

TEST(Laws, FiniteStrainBecomesSmallStrainAtRest) {
  const ElasticResponse small = respond(ElasticLaw::SmallStrain, lame(), Matrix3d::Identity(), 0);
  for (ElasticLaw law : kFiniteLaws) {
    const ElasticResponse r = respond(law, lame(), Matrix3d::Identity(), 0);
    EXPECT_LT(r.P.norm(), 1e-10);
    EXPECT_LT((r.C - small.C).norm(), 1e-12 * small.C.norm());
  }
}

TEST(Laws, StressAndEnergyAreZeroAtRestToTheLastBit) {
  for (double nu : {0., 0.25, 0.3, 0.37, 0.45, 0.49})
    for (ElasticLaw law : kLaws) {
      const LameConstants constants(Material{1e5, nu, 1, 0});
      const ElasticResponse r = respond(law, constants, Matrix3d::Identity(), 0);
      EXPECT_EQ(r.P.norm(), 0) << nu;
      EXPECT_EQ(r.energy, 0) << nu;
    }
}

TEST(Laws, ABarStretchesAsYoungAndPoissonSay) {
  constexpr double E = 1000, nu = 0.3, kStrain = 1e-3;
  const Vector3d stretch(1 + kStrain, 1 - nu * kStrain, 1 - nu * kStrain);
  const ElasticResponse r = respond(ElasticLaw::SmallStrain, lame(), stretch.asDiagonal(), 0);
  EXPECT_LT((r.P - Vector3d(E * kStrain, 0, 0).asDiagonal().toDenseMatrix()).norm(), 1e-12 * E);
  EXPECT_NEAR(r.energy, E * kStrain * kStrain / 2, 1e-12 * E * kStrain);
}

TEST(Laws, FiniteStrainIgnoresRotation) {
  const Matrix3d R = Eigen::AngleAxisd(1, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  for (ElasticLaw law : kFiniteLaws) {
    const ElasticResponse r = respond(law, lame(), deformation(), kShrinkage),
                          rotated = respond(law, lame(), R * deformation(), kShrinkage);
    EXPECT_NEAR(rotated.energy, r.energy, 1e-12 * r.energy);
    EXPECT_LT((rotated.P - R * r.P).norm(), 1e-12 * r.P.norm());
  }
}

TEST(Laws, ShrunkenBodyIsFreeOfStress) {
  for (ElasticLaw law : kLaws)
    EXPECT_LT(respond(law, lame(), (1 - kShrinkage) * Matrix3d::Identity(), kShrinkage).P.norm(), 1e-10);
}

TEST(Laws, NeoHookeanRefusesInversion) {
  Matrix3d F = Matrix3d::Identity();
  F(0, 0) = -1;
  EXPECT_TRUE(std::isinf(respond(ElasticLaw::NeoHookean, lame(), F, 0).energy));
}

}  // namespace
}  // namespace testbed::fem
