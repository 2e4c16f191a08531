#include <gtest/gtest.h>

#include "massspring/energies/springs.h"
#include "massspring/kernels/spring_kernels.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;

constexpr double kRounding = 1e-14;

/// More springs than a batch holds, a few to each first node, one of them without length; about half
/// compressed.
class ManySprings : public testing::TestWithParam<SpringLaw> {
 protected:
  static constexpr int n = 60, kSprings = 300;
  ManySprings() {
    springs.E.resize(2, kSprings);
    for (int s = 0; s < kSprings; ++s) springs.E.col(s) << s / 5, (s / 5 + 1 + 7 * (s % 5)) % n;
    springs.stiffness = Eigen::VectorXd::LinSpaced(kSprings, 1, 3);
    springs.law = GetParam();
    x.col(springs.E(1, 70)) = x.col(springs.E(0, 70));
  }
  Springs springs;
  const Eigen::VectorXd rest = Eigen::VectorXd::LinSpaced(kSprings, 0.3, 1.7);
  Matrix3Xd x = random_points(n, 1, 1);
  const Matrix3Xd p = random_points(n, 1, 2);
};
INSTANTIATE_TEST_SUITE_P(SpringKernels, ManySprings, testing::Values(SpringLaw::Hooke, SpringLaw::Definite),
                         [](const auto& info) {
                           return info.param == SpringLaw::Hooke ? "hooke" : "definite";
                         });

TEST_P(ManySprings, KernelsAddWhatThePlainLoopsAdd) {
  Matrix3Xd f = p, expected_f = p;
  add_forces(springs, rest, x, f);
  plain::add_forces(springs, rest, x, expected_f);
  EXPECT_LT((f - expected_f).norm(), kRounding * f.norm());

  for (const Curvature curvature : {Curvature::Projected, Curvature::Exact}) {
    const SpringBlocks B = hessian(springs, rest, x, 2.5, curvature);
    const SpringBlocks expected = plain::hessian(springs, rest, x, 2.5, curvature);
    ASSERT_GT(expected.norm(), 1);
    EXPECT_LT((B - expected).norm(), kRounding * B.norm());

    Matrix3Xd y = p, expected_y = p;
    add_product(springs, B, p, y);
    plain::add_product(springs, B, p, expected_y);
    EXPECT_LT((y - expected_y).norm(), kRounding * y.norm());

    std::vector<Matrix3d> diagonal(n, Matrix3d::Identity()), expected_diagonal = diagonal;
    add_diagonal(springs, B, diagonal);
    plain::add_diagonal(springs, B, expected_diagonal);
    for (int i = 0; i < n; ++i)
      EXPECT_LT((diagonal[i] - expected_diagonal[i]).norm(), kRounding * diagonal[i].norm()) << i;
  }
}

}  // namespace
}  // namespace testbed::massspring
