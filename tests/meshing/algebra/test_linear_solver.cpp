#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "meshing/algebra/linear_solver.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kSolverTolerance = 1e-12, kAgreement = 1e-8;

/// Chains of n nodes in all, their springs in three directions of stiffness k, and mass 1: hard for k large.
BlockMatrix chain(int n, double k, int length = std::numeric_limits<int>::max()) {
  Eigen::Matrix2Xi pairs(2, n - 1);
  for (int i = 0; i + 1 < n; ++i) pairs.col(i) << i, i + 1;
  BlockMatrix A = make_block_matrix(n, pairs);
  for (int i = 0; i < n; ++i) A.block[A.diagonal[i]].setIdentity();
  for (int i = 0; i + 1 < n; ++i) {
    if ((i + 1) % length == 0) continue;
    Eigen::Matrix3d B = Eigen::Matrix3d::Constant(k / 4);
    B.diagonal().setConstant(k);
    A.block[A.find(i, i)] += B;
    A.block[A.find(i + 1, i + 1)] += B;
    A.block[A.find(i, i + 1)] -= B;
    A.block[A.find(i + 1, i)] -= B;
  }
  return A;
}

Eigen::VectorXd direct(const BlockMatrix& A, const Matrix3Xd& g, const Matrix3Xd& b) {
  Eigen::MatrixXd D = g.reshaped() * g.reshaped().transpose();
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      D.block<3, 3>(3 * i, 3 * A.column[k]) += A.block[k];
  return D.llt().solve(b.reshaped());
}

LinearSystem system_of(const BlockMatrix& A, const Matrix3Xd& g, const Matrix3Xd& positions) {
  return {[&](const Matrix3Xd& p, Matrix3Xd& y) {
            multiply(A, p, y);
            y += g.cwiseProduct(p).sum() * g;
          },
          [&A, &g, A_single = single_precision(A)](const PaddedField& p, PaddedField& y) {
            y.setZero(4, p.cols());
            PaddedField root;
            pad(g, 1, root);
            add_scaled(static_cast<float>(dot(root, p)), root, y);
            return add_product(A, A_single, p, y);
          },
          [](Matrix3Xd&) {},
          [](Matrix3Xd&) {},
          [](PaddedField&) {},
          [&](std::vector<Eigen::Matrix3d>& diagonal) {
            diagonal.clear();
            for (int i : A.diagonal) diagonal.push_back(A.block[i]);
          },
          [&]() -> const BlockMatrix& { return A; },
          &positions};
}

TEST(BlockCholesky, AgreesWithADenseSolveAlsoForBlocksThatAreNotSymmetricAndAfterAnUpdate) {
  constexpr int n = 7;
  BlockMatrix A = chain(n, 1);
  std::optional<BlockCholesky> factor;
  for (const std::uint64_t seed : {1, 2}) {
    for (int i = 0; i + 1 < n; ++i) {
      const Eigen::Matrix3d B = random_points(3, 1, 10 * seed + i);
      A.block[A.find(i, i + 1)] = B;
      A.block[A.find(i + 1, i)] = B.transpose();
      A.block[A.find(i, i)].diagonal().array() += 10;
    }
    if (factor)
      factor->update(A);
    else
      factor.emplace(A);
    ASSERT_TRUE(factor->is_ok());
    const Matrix3Xd b = random_points(n, 1, 3);
    Matrix3Xd x;
    factor->solve(b, x);
    const Eigen::VectorXd exact = dense(A).llt().solve(b.reshaped());
    EXPECT_LT((x.reshaped() - exact).norm(), kSolverTolerance * exact.norm());
    const Eigen::MatrixXd columns = random_points(n * 4, 1, 5).reshaped(3 * n, 4);
    const Eigen::MatrixXd solved = dense(A).llt().solve(columns);
    EXPECT_LT((factor->solve_columns(columns) - solved).norm(), kSolverTolerance * solved.norm());
  }
}

using Pairs = std::vector<std::pair<int, int>>;

/// The lower triangle of a grid's Laplacian, with springs between some nodes that lie apart.
Eigen::SparseMatrix<double> grid(int n, const Pairs& springs) {
  Eigen::MatrixXd A = Eigen::MatrixXd::Zero(n * n, n * n);
  const auto join = [&](int i, int j) {
    for (int k : {i, j}) A(k, k) += 1;
    A(i, j) -= 1;
    A(j, i) -= 1;
  };
  for (int i = 0; i < n * n; ++i) {
    if (i % n > 0) join(i, i - 1);
    if (i >= n) join(i, i - n);
  }
  for (const auto& [i, j] : springs) join(i, j);
  A.diagonal().array() += 0.1;
  return Eigen::MatrixXd(A.triangularView<Eigen::Lower>()).sparseView();
}

TEST(SparseCholesky, FactorisesMatricesOfOtherPatternsAfterOneAnother) {
  constexpr int n = 9;
  Pairs many;
  for (int i = 0; i < n * n / 2; ++i) many.emplace_back(i, n * n - 1 - i);
  const Eigen::MatrixXd b = random_points(n * n, 1, 3).transpose();
  const Pairs one{{0, 80}}, other{{0, 8}};  // of as many entries in each column
  SparseCholesky factor(grid(n, one));
  for (const Pairs& springs : {one, other, Pairs{}, many, Pairs{}, one}) {
    const Eigen::SparseMatrix<double> A = grid(n, springs);
    factor.update(A);
    ASSERT_TRUE(factor.is_ok());
    const Eigen::MatrixXd exact = Eigen::MatrixXd(A).selfadjointView<Eigen::Lower>().llt().solve(b);
    EXPECT_LT((factor.solve(b) - exact).norm(), kSolverTolerance * exact.norm()) << springs.size();
    const Matrix3Xd single = factor.single_precision().solve(b.col(0).reshaped(3, n * n / 3));
    EXPECT_LT((single.reshaped() - exact.col(0)).norm(), 1e-5 * exact.norm()) << springs.size();
  }
}

// Without rounding the residual is gone after as many iterations as the matrix has different eigenvalues.
TEST(BiConjugateGradients, EndAfterAsManyIterationsAsThereAreEigenvalues) {
  constexpr int n = 4;
  constexpr double kTolerance = 1e-9;  // rounding and the condition of the eigenvectors
  const Eigen::Vector4d eigenvalues(1, 2, 4, 7);
  Eigen::MatrixXd V = Eigen::MatrixXd::Identity(3 * n, 3 * n);
  V += random_points(n * 3 * n, 0.2, 5).reshaped(3 * n, 3 * n);
  const Eigen::MatrixXd A = V * eigenvalues.replicate(3, 1).asDiagonal() * V.inverse();
  ASSERT_GT((A - A.transpose()).norm(), 1);
  const Matrix3Xd b = random_points(n, 1, 2);
  const auto by = [](const Eigen::MatrixXd& of) {
    return [&of](const Matrix3Xd& p, Matrix3Xd& y) { y = (of * p.reshaped()).reshaped(3, p.cols()); };
  };
  const Eigen::MatrixXd transposed = A.transpose();
  const auto precondition = [](const Matrix3Xd& r, Matrix3Xd& z) { z = r; };
  for (const bool is_stabilised : {false, true}) {
    Matrix3Xd x = Matrix3Xd::Zero(3, n);
    const SolveReport report =
        is_stabilised ? stabilised_bi_conjugate_gradients(by(A), precondition, b, x, kTolerance, 100)
                      : bi_conjugate_gradients(by(A), by(transposed), precondition, b, x, kTolerance, 100);
    EXPECT_TRUE(report.is_converged);
    EXPECT_EQ(report.iterations, eigenvalues.size());
    EXPECT_LT((A * x.reshaped() - b.reshaped()).norm(), kTolerance * b.norm());
  }
}

/// The matrix of these eigenvalues, each three times, in a random basis.
Eigen::MatrixXd symmetric(const Eigen::Vector4d& eigenvalues) {
  const Eigen::MatrixXd V = random_points(4 * 12, 1, 7).reshaped(12, 12);
  const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(V).householderQ();
  return Q * eigenvalues.replicate(3, 1).asDiagonal() * Q.transpose();
}

template <class Field>
SolveReport solve_symmetric(const Eigen::MatrixXd& A, const Matrix3Xd& b, double tolerance, Matrix3Xd& x) {
  const auto product = [&](const Field& p, Field& y) {
    const Eigen::VectorXd Ap = A * p.template topRows<3>().template cast<double>().reshaped();
    y = Field::Zero(p.rows(), p.cols());
    y.template topRows<3>() = Ap.reshaped(3, p.cols()).template cast<typename Field::Scalar>();
  };
  const auto precondition = [](const Field& r, Field& z) { z = r; };
  Field r = Field::Zero(Field::RowsAtCompileTime, b.cols()), solution = r;
  r.template topRows<3>() = b.cast<typename Field::Scalar>();
  const SolveReport report = conjugate_gradients(product, precondition, r, b.norm(), solution, tolerance, 20);
  x = solution.template topRows<3>().template cast<double>();
  return report;
}

TEST(ConjugateGradients, EndAfterAsManyIterationsAsThereAreEigenvaluesInEitherPrecision) {
  const Eigen::MatrixXd A = symmetric({1, 2, 4, 7});
  const Matrix3Xd b = random_points(4, 1, 2);
  Matrix3Xd x;
  SolveReport report = solve_symmetric<Matrix3Xd>(A, b, 1e-12, x);
  EXPECT_EQ(report.iterations, 4);
  EXPECT_LT((A * x.reshaped() - b.reshaped()).norm(), 2e-12 * b.norm());
  report = solve_symmetric<PaddedField>(A, b, 1e-5, x);
  EXPECT_EQ(report.iterations, 4);
  EXPECT_LT((A * x.reshaped() - b.reshaped()).norm(), 2e-5 * b.norm());
}

TEST(ConjugateGradients, EndAtADirectionOfNegativeCurvatureAndTellIt) {
  Matrix3Xd x;
  const Matrix3Xd b = random_points(4, 1, 2);
  EXPECT_LT(solve_symmetric<Matrix3Xd>(symmetric({-1, -1, -1, -2}), b, 1e-12, x).curvature, -0.9);
  EXPECT_EQ(x.norm(), 0);
  const SolveReport flat = solve_symmetric<Matrix3Xd>(symmetric({0, 0, 0, 0}), b, 1e-12, x);
  EXPECT_FALSE(flat.is_converged);
  EXPECT_FALSE(flat.curvature < 0);
}

TEST(LinearSolver, AgreesWithADirectSolveWhateverItChooses) {
  constexpr int n = 500;  // enough for single precision
  const Matrix3Xd b = random_points(n, 1, 2), g = random_points(n, 0.3, 3);
  for (double k : {0.1, 1e5}) {
    LinearSolver solver;
    const BlockMatrix A = chain(n, k);
    const Eigen::VectorXd exact = direct(A, g, b);
    for (int repeat = 0; repeat < 2; ++repeat) {  // the second one with the factor, where that was chosen
      Matrix3Xd x = Matrix3Xd::Zero(3, n);
      EXPECT_TRUE(solver.solve(system_of(A, g, g), b, x, kSolverTolerance).is_converged);
      EXPECT_LT((x.reshaped() - exact).norm(), kAgreement * exact.norm()) << "k = " << k;
    }
  }
}

// Chains of 60 take too many iterations in single precision alone, and need no factor for that.
TEST(LinearSolver, AgreesWithADirectSolveWhereSinglePrecisionDoesNotReach) {
  constexpr int n = 600;
  for (const auto& [length, k] : {std::pair(30, 1e7), std::pair(60, 1e6)}) {
    const BlockMatrix A = chain(n, k, length);
    const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
    Matrix3Xd exact, x = Matrix3Xd::Zero(3, n);
    BlockCholesky(A).solve(b, exact);
    LinearSolver solver;
    EXPECT_TRUE(solver.solve(system_of(A, none, none), b, x, kSolverTolerance).is_converged);
    EXPECT_EQ(solver.choice().rfind("block Jacobi", 0), 0u) << solver.choice();
    EXPECT_LT((x - exact).norm(), kAgreement * exact.norm());
  }
}

TEST(LinearSolver, KeepsBlockJacobiWhereItIsFastAndAFactorWhereItIsNot) {
  constexpr int n = 300;
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  const BlockMatrix weak = chain(n, 0.1), strong = chain(n, 1e5), stronger = chain(n, 1.1e5);
  LinearSolver soft, stiff;
  Matrix3Xd x = Matrix3Xd::Zero(3, n);
  soft.solve(system_of(weak, none, none), b, x, kSolverTolerance);
  EXPECT_EQ(soft.choice().rfind("block Jacobi", 0), 0u) << soft.choice();
  x.setZero();
  const int slow = stiff.solve(system_of(strong, none, none), b, x, kSolverTolerance).iterations;
  EXPECT_EQ(stiff.choice().rfind("Cholesky", 0), 0u) << stiff.choice();
  x.setZero();
  const int fast = stiff.solve(system_of(stronger, none, none), b, x, kSolverTolerance).iterations;
  EXPECT_LT(fast, slow / 10);
}

TEST(LinearSolver, AFactorServesOnWhereConstraintsHaveComeSince) {
  constexpr int n = 300;
  const Matrix3Xd none = Matrix3Xd::Zero(3, n);
  const BlockMatrix A = chain(n, 1e5);
  Matrix3Xd b = random_points(n, 1, 2), x = Matrix3Xd::Zero(3, n);
  LinearSolver solver;
  solver.solve(system_of(A, none, none), b, x, kSolverTolerance);
  ASSERT_EQ(solver.choice().rfind("Cholesky", 0), 0u) << solver.choice();

  const std::vector<int> constrained{0, 120, 250};
  const auto filter = [&](Matrix3Xd& y) {
    for (int i : constrained) y.col(i).setZero();
  };
  LinearSystem system = system_of(A, none, none);
  system.product = [&](const Matrix3Xd& p, Matrix3Xd& y) {
    multiply(A, p, y);
    filter(y);
  };
  system.constrain = system.filter = filter;
  filter(b);
  x.setZero();
  EXPECT_TRUE(solver.solve(system, b, x, kSolverTolerance).is_converged);
  Eigen::MatrixXd D = dense(A);
  for (int i : constrained) {
    D.middleRows<3>(3 * i).setZero();
    D.middleCols<3>(3 * i).setZero();
    D.block<3, 3>(3 * i, 3 * i).setIdentity();
  }
  const Eigen::VectorXd exact = D.llt().solve(b.reshaped());
  EXPECT_LT((x.reshaped() - exact).norm(), kAgreement * exact.norm());
}

TEST(LinearSolver, TriesBlockJacobiAgainWhereMultigridHasWornOut) {
  constexpr int n = 1500;
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  Matrix3Xd line = Matrix3Xd::Zero(3, n);
  line.row(0) = Eigen::RowVectorXd::LinSpaced(n, 0, n - 1);
  const BlockMatrix weak = chain(n, 0.1), softer = chain(n, 3e3), strong = chain(n, 1e5);
  LinearSolver worn, fresh;
  Matrix3Xd x;
  const auto iterations = [&](LinearSolver& solver, const BlockMatrix& A) {
    x.setZero(3, n);
    const SolveReport report = solver.solve(system_of(A, none, line), b, x, 1e-6);
    EXPECT_TRUE(report.is_converged);
    return report.iterations;
  };
  iterations(worn, strong);
  EXPECT_EQ(worn.choice().rfind("multigrid", 0), 0u) << worn.choice();
  for (int repeat = 0; repeat < 10 && worn.choice().rfind("multigrid", 0) == 0; ++repeat)
    EXPECT_LT(iterations(worn, softer), 100) << "else it stands still";
  EXPECT_EQ(worn.choice().rfind("block Jacobi", 0), 0u) << worn.choice();
  EXPECT_EQ(iterations(worn, weak), iterations(fresh, weak));
}

TEST(LinearSolver, TakesMultigridOnManyNodes) {
  constexpr int n = 40000;
  Matrix3Xd x = Matrix3Xd::Zero(3, n), line = Matrix3Xd::Zero(3, n), exact;
  line.row(0) = Eigen::RowVectorXd::LinSpaced(n, 0, n - 1);
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  const BlockMatrix A = chain(n, 1e5);
  LinearSolver solver;
  EXPECT_TRUE(solver.solve(system_of(A, none, line), b, x, kSolverTolerance).is_converged);
  EXPECT_EQ(solver.choice().rfind("multigrid", 0), 0u) << solver.choice();
  BlockCholesky(A).solve(b, exact);  // a chain has no fill
  EXPECT_LT((x - exact).norm(), kAgreement * exact.norm());
}

// Each system alone is easy enough for block Jacobi.
TEST(LinearSolver, ChoosesByIterationsSummedOverTheRun) {
  constexpr int n = 600;
  Matrix3Xd x, line = Matrix3Xd::Zero(3, n);
  line.row(0) = Eigen::RowVectorXd::LinSpaced(n, 0, n - 1);
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  const BlockMatrix A = chain(n, 300);
  LinearSolver solver;
  std::vector<int> iterations;
  for (int repeat = 0; repeat < 8; ++repeat) {
    x.setZero(3, n);
    const SolveReport report = solver.solve(system_of(A, none, line), b, x, 1e-6);
    EXPECT_TRUE(report.is_converged);
    iterations.push_back(report.iterations);
  }
  EXPECT_GT(iterations[0], 160);
  EXPECT_LT(iterations[0], 500);
  EXPECT_EQ(iterations[0], iterations[1]);
  EXPECT_LT(iterations.back(), iterations[0] / 4);
  EXPECT_NE(solver.choice().find("in sum"), std::string::npos) << solver.choice();
}

TEST(LinearSolver, EndsAfterAThousandIterationsWithAnUnsuitedFactor) {
  constexpr int n = 1000;
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  const BlockMatrix A = chain(n, 1e9), unsuited = chain(n, 1);
  LinearSystem system = system_of(A, none, none);
  system.matrix = [&]() -> const BlockMatrix& { return unsuited; };
  Matrix3Xd x = Matrix3Xd::Zero(3, n);
  const SolveReport report = LinearSolver::of_factor("").solve(system, b, x, kSolverTolerance);
  EXPECT_EQ(report.iterations, 1000);
  EXPECT_FALSE(report.is_converged);
}

// Groups of nodes that lie all in one place cannot follow the bends of a chain.
TEST(LinearSolver, FactorisesWhereMultigridStandsStillAndSaysSo) {
  constexpr int n = 4000;
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  BlockMatrix A = chain(n, 1e5);
  LinearSystem system = system_of(A, none, none);
  int n_calls = 0;
  BlockMatrix poor = chain(n, 1);  // of which multigrid is made first
  system.matrix = [&]() -> const BlockMatrix& { return n_calls++ == 0 ? poor : A; };
  LinearSolver solver = LinearSolver::of_stiffness(false);
  Matrix3Xd x = Matrix3Xd::Zero(3, n), exact;
  const SolveReport report = solver.solve(system, b, x, kSolverTolerance);
  EXPECT_TRUE(report.is_converged);
  EXPECT_LT(report.iterations, 160);  // twelve for each digit, and some with the factor
  EXPECT_EQ(solver.choice().rfind("Cholesky factor: multigrid took more than", 0), 0u) << solver.choice();
  BlockCholesky(A).solve(b, exact);
  EXPECT_LT((x - exact).norm(), kAgreement * exact.norm());
}

// A preconditioner of a far softer chain takes more iterations than a good one, and fewer than a factor is worth.
TEST(LinearSolver, GoesOnWithMultigridWhereThatGains) {
  constexpr int n = 4000;
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  Matrix3Xd line = none, x = none;
  line.row(0) = Eigen::RowVectorXd::LinSpaced(n, 0, n - 1);
  const BlockMatrix A = chain(n, 1e5), softer = chain(n, 1200);
  LinearSystem system = system_of(A, none, line);
  system.matrix = [&]() -> const BlockMatrix& { return softer; };
  LinearSolver solver = LinearSolver::of_stiffness(false);
  const SolveReport report = solver.solve(system, b, x, kSolverTolerance);
  EXPECT_TRUE(report.is_converged);
  EXPECT_GT(report.iterations, 150);
  EXPECT_EQ(solver.choice().rfind("multigrid", 0), 0u) << solver.choice();
}

class HalvedEdges : public testing::Test {
 protected:
  static constexpr int n = 1999, kCoarse = 1000;
  const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
  const BlockMatrix A = chain(n, 1e5);
  Matrix3Xd line = none, x = none, exact;
  Eigen::Matrix2Xi between{2, n};

  void SetUp() override {
    line.row(0) = Eigen::RowVectorXd::LinSpaced(n, 0, n - 1);
    for (int i = 0; i < n; ++i) between.col(i) << i / 2, (i + 1) / 2;
    BlockCholesky(A).solve(b, exact);
  }
  SolveReport solve(LinearSolver& solver) {
    return solver.solve(system_of(A, none, line), b, x, kSolverTolerance);
  }
};

// Two springs in a row are half as stiff, and twice as much ground holds each node.
TEST_F(HalvedEdges, TakeFewIterationsAboveTheSolutionOfTheOthers) {
  const auto coarser = BlockCholesky(chain(kCoarse, 1e5 / 4)).single_precision();
  LinearSolver solver = LinearSolver::of_halved_edges(
      between, [&](const PaddedField& r, PaddedField& z) { coarser.solve(0.5F * r, z); });
  const SolveReport report = solve(solver);
  EXPECT_TRUE(report.is_converged);
  EXPECT_LT(report.iterations, 21) << "of single precision no more is asked than it has";
  EXPECT_LT((x - exact).norm(), kAgreement * exact.norm());
  EXPECT_EQ(solver.choice().rfind("multigrid: above that", 0), 0u) << solver.choice();
}

TEST_F(HalvedEdges, GoOnWhereTheDigitsGainedPromiseAnEnd) {
  const auto coarser = BlockCholesky(chain(kCoarse, 1e5 / 4)).single_precision();
  LinearSolver solver = LinearSolver::of_halved_edges(
      between, [&](const PaddedField& r, PaddedField& z) { coarser.solve(0.006F * r, z); });
  const SolveReport report = solve(solver);
  EXPECT_TRUE(report.is_converged);
  EXPECT_GT(report.iterations, 150);
  EXPECT_LT((x - exact).norm(), kAgreement * exact.norm());
}

TEST_F(HalvedEdges, EndWhereTheOthersDoNotServe) {
  LinearSolver solver = LinearSolver::of_halved_edges(
      between, [](const PaddedField& r, PaddedField& z) { z.setZero(4, r.cols()); });
  const SolveReport report = solve(solver);
  EXPECT_FALSE(report.is_converged);
  EXPECT_LE(report.iterations, 100);
  EXPECT_EQ(solver.choice().rfind("multigrid: above that", 0), 0u) << solver.choice();
}

TEST(LinearSolver, LendsThePreconditionerOfItsLastSystem) {
  const Matrix3Xd none = Matrix3Xd::Zero(3, 600);
  for (const int n : {200, 600}) {
    const BlockMatrix A = chain(n, 100);
    const Matrix3Xd b = random_points(n, 1, 2);
    Matrix3Xd x = Matrix3Xd::Zero(3, n), found = x;
    LinearSolver solver = LinearSolver::of_factor("asked for");
    EXPECT_FALSE(solver.preconditioner());
    solver.solve(system_of(A, none.leftCols(n), none.leftCols(n)), b, x, kSolverTolerance);
    PaddedField r, z;
    pad(b, 1, r);
    solver.preconditioner()(r, z);
    add_unpadded(z, 1, found);
    EXPECT_LT((found - x).norm(), 1e-4 * x.norm());
  }
}

// Whatever preconditioner it keeps: the block Jacobi of easy systems, a factor of few nodes, multigrid of many.
TEST(LinearSolver, GoesOnFromAnArchiveBitForBit) {
  for (const auto& [n, stiffness, choice] :
       {std::tuple(600, 0.1, "block Jacobi"), std::tuple(400, 1e5, "Cholesky factor"),
        std::tuple(600, 1e5, "multigrid")}) {
    Matrix3Xd line = Matrix3Xd::Zero(3, n);
    line.row(0) = Eigen::RowVectorXd::LinSpaced(n, 0, n - 1);
    const Matrix3Xd b = random_points(n, 1, 2), none = Matrix3Xd::Zero(3, n);
    const BlockMatrix first = chain(n, stiffness), second = chain(n, 1.2 * stiffness);
    LinearSolver whole;
    Matrix3Xd x = Matrix3Xd::Zero(3, n), found = x, fresh = x;
    whole.solve(system_of(first, none, line), b, x, 1e-6);
    Archive to;
    to(whole);
    LinearSolver again, forgetful;
    Archive from(to.bytes());
    from(again);
    EXPECT_EQ(again.choice(), whole.choice());
    EXPECT_EQ(whole.choice().rfind(choice, 0), 0u) << whole.choice();
    x.setZero();
    const SolveReport expected = whole.solve(system_of(second, none, line), b, x, 1e-6),
                      report = again.solve(system_of(second, none, line), b, found, 1e-6);
    EXPECT_EQ(found, x) << choice;
    EXPECT_EQ(report.iterations, expected.iterations);
    if (stiffness < 1) continue;
    forgetful.solve(system_of(second, none, line), b, fresh, 1e-6);
    EXPECT_NE(fresh, x) << "what was kept decides";
  }
}

}  // namespace
}  // namespace testbed::massspring
