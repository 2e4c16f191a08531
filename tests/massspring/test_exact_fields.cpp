#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <stdexcept>

#include "massspring/exact_fields.h"
#include "massspring/tractions.h"
#include "tests/massspring/box_tets.h"

namespace testbed {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr double rounding = 1e-12;
constexpr double difference_step = 1e-3;  // the fields are quadratic: central differences are exact but for
constexpr double difference_tolerance = 1e-10;  // rounding
const Lame lame{3, 2};
const Vector3d centre(0.1, 0.2, 0.3), somewhere(0.7, -0.4, 0.9);

class EveryField : public testing::TestWithParam<std::string> {
 protected:
  ExactField field = exact_field(GetParam(), lame, centre);
};
INSTANTIATE_TEST_SUITE_P(ExactField, EveryField, testing::ValuesIn(exact_field_names()),
                         [](const auto& info) { return info.param; });

TEST_P(EveryField, StressFollowsFromDisplacementByHookesLaw) {
  Matrix3d G;
  for (int j = 0; j < 3; ++j) {
    const Vector3d h = difference_step * Vector3d::Unit(j);
    G.col(j) =
        (field.displacement(somewhere + h) - field.displacement(somewhere - h)) / (2 * difference_step);
  }
  const Matrix3d sigma = lame.lambda * G.trace() * Matrix3d::Identity() + lame.mu * (G + G.transpose());
  ASSERT_GT(sigma.norm(), 0.1);
  EXPECT_LT((field.stress(somewhere) - sigma).norm(), difference_tolerance);
}

TEST_P(EveryField, StressIsInEquilibriumWithoutBodyForce) {
  Vector3d divergence = Vector3d::Zero();
  for (int j = 0; j < 3; ++j) {
    const Vector3d h = difference_step * Vector3d::Unit(j);
    divergence += (field.stress(somewhere + h) - field.stress(somewhere - h)).col(j) / (2 * difference_step);
  }
  EXPECT_LT(divergence.norm(), difference_tolerance);
}

TEST_P(EveryField, TractionsOfAClosedBodyBalance) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.2);
  const Matrix3Xd f = traction_forces(field.stress, mesh.X, mesh.F);
  ASSERT_GT(f.norm(), 0.1);
  Vector3d torque = Vector3d::Zero();
  for (Eigen::Index i = 0; i < f.cols(); ++i) torque += mesh.X.col(i).cross(f.col(i));
  EXPECT_LT(f.rowwise().sum().norm(), rounding * f.norm());
  EXPECT_LT(torque.norm(), rounding * f.norm());
}

class LinearField : public EveryField {};
INSTANTIATE_TEST_SUITE_P(ExactField, LinearField, testing::Values("pressure", "uniaxial", "shear"),
                         [](const auto& info) { return info.param; });

TEST_P(LinearField, WorkOfTractionsIsTwiceTheStrainEnergy) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.2);
  Matrix3d G;
  for (int j = 0; j < 3; ++j)
    G.col(j) = field.displacement(centre + Vector3d::Unit(j)) - field.displacement(centre);
  const double work =
      traction_forces(field.stress, mesh.X, mesh.F).cwiseProduct(displacements(field, mesh.X)).sum();
  const double V = lumped_mass(mesh.X, mesh.T, 1).sum();
  EXPECT_NEAR(work, V * field.stress(centre).cwiseProduct(G).sum(), rounding * V * 100);
}

// Integrals of x^3 times 1 - x - y, x and y over the unit triangle.
TEST(TractionForces, AreExactForCubicStress) {
  Matrix3Xd X(3, 3);
  X << 0, 1, 0, 0, 0, 1, 0, 0, 0;
  const Matrix3Xd f = traction_forces(
      [](const Vector3d& x) -> Matrix3d {
        return std::pow(x(0), 3) * Vector3d(0, 0, 1) * Vector3d(0, 0, 1).transpose();
      },
      X, Eigen::Vector3i(0, 1, 2));
  EXPECT_LT((f.row(2) - Eigen::RowVector3d(1. / 120, 1. / 30, 1. / 120)).norm(), rounding);
  EXPECT_EQ(f.topRows<2>().norm(), 0);
}

TEST(ExactField, RefusesAnUnknownName) {
  EXPECT_THROW(exact_field("bend", lame, centre), std::runtime_error);
}

TEST(SurfaceError, IgnoresSmallRigidMotionAndSeesTheRest) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.5, 0.2);
  const Matrix3Xd exact = displacements(exact_field("bending", lame, centre), mesh.X);
  Matrix3Xd moved = exact;
  for (Eigen::Index i = 0; i < moved.cols(); ++i)
    moved.col(i) += Vector3d(1, 2, 3) + Vector3d(3, 2, 1).cross(mesh.X.col(i));
  EXPECT_LT(surface_error(moved, exact, mesh.X, mesh.F).l2, rounding * 100);
  EXPECT_NEAR(surface_error(1.1 * exact, exact, mesh.X, mesh.F).l2, 0.1, rounding);
  EXPECT_NEAR(surface_error(1.1 * exact, exact, mesh.X, mesh.F).largest, 0.1, rounding);
}

}  // namespace
}  // namespace testbed
