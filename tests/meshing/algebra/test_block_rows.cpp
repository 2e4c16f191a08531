#include <gtest/gtest.h>

#include <Eigen/LU>

#include "meshing/algebra/block_rows.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSingleRounding = 1e-5;

template <class Size>
class Rows : public testing::Test {
 protected:
  static constexpr int D = Size::value, n = 4, kSize = D * n;
  using Field = FieldOf<D>;
  // Diagonally dominant; the rows at the ends do not meet.
  const MatrixXd full = [] {
    MatrixXd result = MatrixXd(random_points(kSize * kSize / 3, 1, 8).reshaped(kSize, kSize)) +
                      20 * MatrixXd::Identity(kSize, kSize);
    result.template topRightCorner<D, D>().setZero();
    result.template bottomLeftCorner<D, D>().setZero();
    return result;
  }();
  const BlockRows<D> A = [this] {
    BlockRows<D> result;
    for (int i = 0; i < n; ++i) {
      result.row_start.push_back(static_cast<int>(result.column.size()));
      for (int j = 0; j < n; ++j) {
        if (std::abs(i - j) == n - 1) continue;
        if (i == j) result.diagonal.push_back(static_cast<int>(result.column.size()));
        result.column.push_back(j);
        append(full.block<D, D>(D * i, D * j), result.block);
      }
      append(full.block<D, D>(D * i, D * i).inverse(), result.inverse);
    }
    result.row_start.push_back(static_cast<int>(result.column.size()));
    result.block.resize(result.block.size() + 2);
    result.inverse.resize(result.inverse.size() + 2);
    return result;
  }();
  const VectorXd b = random_points(kSize / 3, 1, 9).reshaped();

  static void append(const MatrixXd& block, std::vector<float>& blocks) {
    for (const double entry : block.reshaped()) blocks.push_back(static_cast<float>(entry));
  }
  static Field field_of(const VectorXd& v) {
    Field result = Field::Zero(D == 3 ? 4 : 8, n);
    result.template topRows<D>() = v.reshaped(D, n).template cast<float>();
    return result;
  }
  template <class Found>
  static void expect_field(const Found& found, int n_rows, const VectorXd& expected) {
    const VectorXd counted = found.topRows(n_rows).template cast<double>().reshaped();
    EXPECT_LT((counted - expected).norm(), kSingleRounding * expected.norm());
  }
  /// The blocks of A that are kept.
  template <class Keep>
  MatrixXd part(const Keep& keep) const {
    MatrixXd result = MatrixXd::Zero(kSize, kSize);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j)
        if (keep(i, j)) result.block<D, D>(D * i, D * j) = full.block<D, D>(D * i, D * j);
    return result;
  }
};

using Sizes = testing::Types<std::integral_constant<int, 3>, std::integral_constant<int, 6>>;
TYPED_TEST_SUITE(Rows, Sizes, );

TYPED_TEST(Rows, SweepsAreThoseOfBlockGaussSeidel) {
  constexpr int D = TypeParam::value;
  const VectorXd& b = this->b;
  FieldOf<D> x, r;
  sweep_down(this->A, this->field_of(b), x);
  const VectorXd down = this->part([](int i, int j) { return j <= i; }).lu().solve(b);
  this->expect_field(x, D, down);
  rest_of_sweep(this->A, x, r);
  this->expect_field(r, D, b - this->full * down);
  sweep_up(this->A, this->field_of(b), x);
  this->expect_field(
      x, D, down + this->part([](int i, int j) { return j >= i; }).lu().solve(b - this->full * down));
}

TYPED_TEST(Rows, ApplyAsTheMatrixAndAsTheInverseOfItsDiagonalBlocks) {
  constexpr int D = TypeParam::value;
  FieldOf<D> y;
  multiply(this->A, this->field_of(this->b), y);
  this->expect_field(y, D, this->full * this->b);
  multiply_inverse(this->A, this->field_of(this->b), y);
  this->expect_field(y, D, this->part([](int i, int j) { return i == j; }).lu().solve(this->b));
}

TYPED_TEST(Rows, FollowBodiesAndAreFeltByThem) {
  constexpr int D = TypeParam::value, n = 4, kBodies = 2;
  MatrixXd P = random_points(D * n * 6 * kBodies / 3, 1, 10).reshaped(D * n, 6 * kBodies);
  P.block<D, 6>(D, 6).setZero();  // row 1 follows the first alone, row 3 neither
  P.bottomRows<D>().setZero();
  BodyRows<D> rows;
  rows.row_start = {0, 2, 3, 5, 5};
  rows.column = {0, 1, 0, 1, 0};
  for (const auto& [i, g] : {std::pair(0, 0), {0, 1}, {1, 0}, {2, 1}, {2, 0}})
    this->append(P.block<D, 6>(D * i, 6 * g).transpose(), rows.block);
  rows.block.resize(rows.block.size() + 2);
  BodyField wrench(8, kBodies);
  gather(rows, this->field_of(this->b), wrench);
  this->expect_field(wrench, 6, P.transpose() * this->b);
  const VectorXd motion = random_points(2 * kBodies, 1, 11).reshaped();
  BodyField of_bodies = BodyField::Constant(8, kBodies, 3);
  of_bodies.topRows<6>() = motion.reshaped(6, kBodies).cast<float>();
  FieldOf<D> x = this->field_of(this->b);
  add_motion(rows, of_bodies, x);
  this->expect_field(x, D, this->b + P * motion);
}

}  // namespace
}  // namespace testbed::massspring
