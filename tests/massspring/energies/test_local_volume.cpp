#include <gtest/gtest.h>

#include "massspring/energies/local_volume.h"
#include "meshing/base/geometry.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kDifferenceStep = 1e-5, kDifferenceTolerance = 1e-8;

class LocalVolumeForce : public testing::Test {
 protected:
  const TetMesh mesh = box_tets(2, 1, 1, 0.5, 0.1);
  LocalVolume local{30, mesh.T, Eigen::VectorXd(mesh.T.cols())};
  const Matrix3Xd x = 1.1 * mesh.X + random_points(static_cast<int>(mesh.X.cols()), 0.05, 5);
  LocalVolumeForce() {
    for (int t = 0; t < mesh.T.cols(); ++t) local.rest_volume[t] = tet_volume(mesh.X, mesh.T.col(t));
  }
  Matrix3Xd forces(const Matrix3Xd& at) const {
    Matrix3Xd f = Matrix3Xd::Zero(3, at.cols());
    add_forces(local, at, f);
    return f;
  }
};

TEST_F(LocalVolumeForce, IsMinusEnergyGradient) {
  const Matrix3Xd f = forces(x);
  ASSERT_GT(f.norm(), 0.1);
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x;
    up(k) += kDifferenceStep;
    down(k) -= kDifferenceStep;
    EXPECT_NEAR(f(k), -(energy(local, up) - energy(local, down)) / (2 * kDifferenceStep),
                kDifferenceTolerance * f.norm());
  }
}

TEST_F(LocalVolumeForce, HessianIsMinusForceGradientAtRest) {
  BlockMatrix K = make_block_matrix(static_cast<int>(x.cols()), pairs_of(local));
  add_hessian(local, mesh.X, K);
  mirror(K);
  const Matrix3Xd p = random_points(static_cast<int>(x.cols()), 1, 6);
  Matrix3Xd Kp;
  multiply(K, p, Kp);
  ASSERT_GT(Kp.norm(), 0.1);
  const Matrix3Xd difference =
      (forces(mesh.X - kDifferenceStep * p) - forces(mesh.X + kDifferenceStep * p)) / (2 * kDifferenceStep);
  EXPECT_LT((Kp - difference).norm(), kDifferenceTolerance * Kp.norm());
}

}  // namespace
}  // namespace testbed::massspring
