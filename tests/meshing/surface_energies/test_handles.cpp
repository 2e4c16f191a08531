#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "meshing/surface_energies/handles.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

class HandleTest : public testing::Test {
 protected:
  HandleTest() { pulled.begin_step(0.25, 0.25, x); }

  const Matrix3Xd X = random_points(6, 1, 3), x = random_points(6, 1, 4), p = random_points(6, 1, 5);
  const meshing::Handle handle{{}, {}, 30, {{0, 0, 0, 0}, {1, 2, 4, 8}}, 0.25, 2};
  const meshing::SurfaceProblem::Held held{{1, 4, 5}, handle};
  HandleSprings pulled{held, X, Eigen::Matrix3d::Identity(), 0};

  Matrix3Xd forces(const Matrix3Xd& at) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, at.cols());
    pulled.add_forces(at, f);
    return f;
  }
};

TEST_F(HandleTest, PullsEachOfItsVerticesByAnEqualShareToWhereItsEndIs) {
  const Vector3d shift(1, 2, 4);  // of motion at 0.5 s
  EXPECT_TRUE(forces(x).col(4).isApprox(10 * (X.col(4) + shift - x.col(4))));
  EXPECT_TRUE(forces(x).col(0).isZero(0));
  Matrix3Xd there = x;
  for (const int i : held.vertices) there.col(i) = X.col(i) + shift;
  EXPECT_NEAR(pulled.energy(there), 0, 1e-28);
}

TEST_F(HandleTest, ForceIsMinusEnergyGradientAndHessianMinusForceGradient) {
  constexpr double kStep = 1e-3, kRounding = 1e-10;  // of a quadratic energy differences are exact
  const double slope = (pulled.energy(x + kStep * p) - pulled.energy(x - kStep * p)) / (2 * kStep);
  EXPECT_NEAR(slope, -forces(x).cwiseProduct(p).sum(), kRounding * forces(x).norm());
  SurfaceHessian H;
  pulled.add_hessian(x, H, Curvature::Projected);
  Matrix3Xd Hp = Matrix3Xd::Zero(3, 6);
  H.add_product(p, Hp);
  EXPECT_TRUE(Hp.isApprox(forces(x) - forces(x + p), 1e-12));
}

TEST_F(HandleTest, HoldsFromItsStartToItsEnd) {
  const auto is_held_at = [&](double end_of_step) {
    pulled.begin_step(end_of_step - 0.125, 0.125, x);
    return pulled.energy(x) > 0;
  };
  EXPECT_FALSE(is_held_at(0.125));
  EXPECT_TRUE(is_held_at(0.25));
  EXPECT_TRUE(is_held_at(1.875));
  EXPECT_FALSE(is_held_at(2));
  EXPECT_GT((HandleSprings{held, X, Eigen::Matrix3d::Identity(), 0}.energy(x)), 0)
      << "its stiffness can be asked for";
}

TEST_F(HandleTest, IsTheSameInOtherAxes) {
  const Eigen::Matrix3d frame = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  HandleSprings turned(held, frame.transpose() * X, frame, 0);
  turned.begin_step(0.25, 0.25, x);
  EXPECT_NEAR(turned.energy(frame.transpose() * x), pulled.energy(x), 1e-12 * pulled.energy(x));
}

}  // namespace
}  // namespace testbed::massspring
