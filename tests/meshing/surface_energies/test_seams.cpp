#include <gtest/gtest.h>

#include "meshing/surface_energies/seams.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

class SewnPoints : public testing::Test {
 protected:
  const Seams seams{(Eigen::Matrix2Xi(2, 3) << 0, 1, 0, 3, 4, 5).finished(), Eigen::Vector3d(2, 30, 0.5)};
  const Matrix3Xd x = random_points(6, 1, 3), p = random_points(6, 1, 4);
  Matrix3Xd forces(const Matrix3Xd& at) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, at.cols());
    add_forces(seams, at, f);
    return f;
  }
};

TEST_F(SewnPoints, ForceIsMinusEnergyGradientAndPullsTheEndsTogether) {
  constexpr double kStep = 1e-3, kRounding = 1e-10;  // of a quadratic energy differences are exact
  const double slope = (energy(seams, x + kStep * p) - energy(seams, x - kStep * p)) / (2 * kStep);
  EXPECT_NEAR(slope, -forces(x).cwiseProduct(p).sum(), kRounding * forces(x).norm());
  EXPECT_TRUE(forces(x).col(3).isApprox(2 * (x.col(0) - x.col(3))));
  EXPECT_TRUE(forces(x).col(2).isZero(0));
}

TEST_F(SewnPoints, HessianIsMinusForceGradient) {
  BlockMatrix K = make_block_matrix(6, pairs_of(seams));
  add_hessian(seams, x, K);
  mirror(K);
  Matrix3Xd Kp;
  multiply(K, p, Kp);
  EXPECT_TRUE(Kp.isApprox(forces(x) - forces(x + p), 1e-12));
}

TEST_F(SewnPoints, InAListAreWhatTheyAre) {
  const PlainEnergy<Seams> listed(seams);
  EXPECT_EQ(listed.energy(x), energy(seams, x));
  Matrix3Xd f = Matrix3Xd::Zero(3, 6), Kp = f;
  listed.add_forces(x, f);
  EXPECT_EQ(f, forces(x));
  SurfaceHessian H;
  listed.add_hessian(x, H, Curvature::Exact);
  H.add_product(p, Kp);
  EXPECT_TRUE(Kp.isApprox(forces(x) - forces(x + p), 1e-12));
}

}  // namespace
}  // namespace testbed::massspring
