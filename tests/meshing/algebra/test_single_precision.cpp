#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "massspring/kernels/spring_rows.h"
#include "meshing/algebra/single_precision.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;

constexpr double kSingleRounding = 1e-5;  // 6e-8 times the root of what is added, with room

double product(const Matrix3Xd& u, const Matrix3Xd& w) {
  return u.cwiseProduct(w).sum();
}

/// Of these numbers of nodes none fills the last register, and the second is more than is added in single
/// precision.
class OddNodes : public testing::TestWithParam<int> {
 protected:
  const int n = GetParam();
  const Matrix3Xd u = random_points(n, 1, 1), w = random_points(n, 1, 2), r = random_points(n, 1, 3);

  static PaddedField padded_field(const Matrix3Xd& field) {
    PaddedField result;
    pad(field, 1, result);
    return result;
  }
  /// The field is what is expected, and what pads it still 0.
  void expect_field(const PaddedField& found, const Matrix3Xd& expected) const {
    ASSERT_EQ(found.cols(), padded(n));
    EXPECT_LT((found.topLeftCorner(3, n).cast<double>() - expected).norm(),
              kSingleRounding * expected.norm());
    EXPECT_EQ(found.row(3).norm() + found.rightCols(found.cols() - n).norm(), 0);
  }
  void expect_sum(double found, const Matrix3Xd& a, const Matrix3Xd& b) const {
    EXPECT_NEAR(found, product(a, b), kSingleRounding * a.norm() * b.norm());
  }
  std::vector<Eigen::Matrix3d> symmetric_blocks() const {
    const Matrix3Xd entries = random_points(3 * n, 1, 4);
    std::vector<Eigen::Matrix3d> blocks;
    for (int i = 0; i < n; ++i)
      blocks.emplace_back(entries.middleCols<3>(3 * i) + entries.middleCols<3>(3 * i).transpose());
    return blocks;
  }
  static Matrix3Xd times(const std::vector<Eigen::Matrix3d>& blocks, const Matrix3Xd& field) {
    Matrix3Xd result(3, field.cols());
    for (Eigen::Index i = 0; i < field.cols(); ++i) result.col(i) = blocks[i] * field.col(i);
    return result;
  }
};
INSTANTIATE_TEST_SUITE_P(SinglePrecision, OddNodes, testing::Values(7, 601));

TEST_P(OddNodes, FieldsArePaddedTimesAFactorAndBack) {
  PaddedField found;
  pad(u, 3, found);
  expect_field(found, 3 * u);
  Matrix3Xd back = w;
  add_unpadded(found, 0.5, back);
  EXPECT_LT((back - w - 1.5 * u).norm(), kSingleRounding * u.norm());
}

TEST_P(OddNodes, StepsOfConjugateGradientsAreThoseOfDoublePrecision) {
  constexpr float kFactor = 0.7f;
  expect_sum(dot(padded_field(u), padded_field(w)), u, w);
  PaddedField x = padded_field(u), rest = padded_field(r);
  const Matrix3Xd expected_rest = r - kFactor * u;
  expect_sum(advance(kFactor, padded_field(w), padded_field(u), x, rest), expected_rest, expected_rest);
  expect_field(x, u + kFactor * w);
  expect_field(rest, expected_rest);
  aypx(kFactor, padded_field(w), x);
  expect_field(x, w + kFactor * (u + kFactor * w));
  PaddedField y = padded_field(u);
  add_scaled(kFactor, padded_field(w), y);
  expect_field(y, u + kFactor * w);
}

TEST_P(OddNodes, BlocksAndFactorsOfNodesApplyAsInDoublePrecision) {
  const std::vector<Eigen::Matrix3d> blocks = symmetric_blocks();
  const SymmetricBlocks D = pad(blocks);
  PaddedField z;
  expect_sum(multiply(D, padded_field(r), z), r, times(blocks, r));
  expect_field(z, times(blocks, r));
  const Eigen::VectorXd factor = Eigen::VectorXd::LinSpaced(n, -1, 2);
  multiply(factor.cast<float>().eval(), padded_field(u), z);
  expect_field(z, u * factor.asDiagonal());
}

TEST(SinglePrecision, SpringsInRowsAndSingleBlocksApplyAsTheMatrix) {
  const MassSpringModel model = small_model();
  const Matrix3Xd x = 1.2 * model.network.X + random_points(5, 0.1, 5), p = random_points(5, 1, 6),
                  start = random_points(5, 1, 7);
  const SpringBlocks B = hessian(*model.springs, initial_state(model).rest_length, x);
  BlockMatrix K = make_block_matrix(5, model.springs->E);
  add_blocks(*model.springs, B, K);
  mirror(K);
  const Matrix3Xd expected = start + (dense(K) * p.reshaped()).reshaped(3, 5);
  PaddedField single_p, in_rows, by_blocks;
  pad(p, 1, single_p);
  pad(start, 1, in_rows);
  by_blocks = in_rows;
  const SpringRows rows(model.springs->E, 5);
  const double p_y = product(p, expected), tolerance = kSingleRounding * p.norm() * expected.norm();
  EXPECT_NEAR(rows.add_product(rows.in_rows(B), single_p, in_rows), p_y, tolerance);
  EXPECT_NEAR(add_product(K, single_precision(K), single_p, by_blocks), p_y, tolerance);
  for (const PaddedField& y : {in_rows, by_blocks})
    EXPECT_LT((y.topLeftCorner<3, 5>().cast<double>() - expected).norm(), kSingleRounding * expected.norm());
}

}  // namespace
}  // namespace testbed::massspring
