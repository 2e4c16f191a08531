#include "meshing/algebra/lowest_modes.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

namespace testbed::meshing {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A^T B.
MatrixXd products(const Pencil& pencil, const MatrixXd& A, const MatrixXd& B) {
  MatrixXd sums = A.transpose() * B;
  pencil.add_up(sums);
  return sums;
}

/// Columns that are orthonormal in M, and M times them.
struct Basis {
  MatrixXd V, MV;

  /// Adds what columns of B are independent of these and of each other.
  void append(const Pencil& pencil, MatrixXd B) {
    constexpr double kDependent = 1e-12;  // of a column's length, what projection may leave of one
    constexpr double kDependentSquare =
        1e-14;                  // of the largest eigenvalue of the Gram matrix of unit columns
    constexpr int kPasses = 2;  // the second takes away what rounding left
    const Pencil::Operator& mass = pencil.mass;
    VectorXd before = lengths(pencil, B, mass(B));
    for (int pass = 0; pass < kPasses; ++pass) {
      if (V.cols() > 0) B -= V * products(pencil, MV, B);
      MatrixXd MB = mass(B);
      const VectorXd after = lengths(pencil, B, MB);
      std::vector<Index> kept;
      for (Index k = 0; k < B.cols(); ++k)
        if (after(k) > kDependent * before(k)) kept.push_back(k);
      if (kept.empty()) return;
      B = (B(Eigen::all, kept) * after(kept).cwiseInverse().asDiagonal()).eval();
      MB = (MB(Eigen::all, kept) * after(kept).cwiseInverse().asDiagonal()).eval();
      const Eigen::SelfAdjointEigenSolver<MatrixXd> gram(products(pencil, B, MB));
      const VectorXd& lambda = gram.eigenvalues();  // ascending
      const Index n = (lambda.array() > kDependentSquare * lambda(lambda.size() - 1)).count();
      B = B * (gram.eigenvectors().rightCols(n) * lambda.tail(n).cwiseSqrt().cwiseInverse().asDiagonal());
      before = VectorXd::Ones(n);
    }
    V.conservativeResize(B.rows(), V.cols() + B.cols());
    V.rightCols(B.cols()) = B;
    MV.conservativeResize(B.rows(), V.cols());
    MV.rightCols(B.cols()) = mass(B);
  }

  static VectorXd lengths(const Pencil& pencil, const MatrixXd& B, const MatrixXd& MB) {
    MatrixXd squares = B.cwiseProduct(MB).colwise().sum().transpose();
    pencil.add_up(squares);
    return squares.cwiseMax(0).cwiseSqrt();
  }
};

MatrixXd random_columns(Index n_rows, Index n) {
  std::mt19937_64 random(1);
  return MatrixXd::NullaryExpr(n_rows, n, [&] { return std::ldexp(static_cast<double>(random()), -63) - 1; });
}

/// The lowest Ritz pairs of a block of so many columns.
std::pair<VectorXd, MatrixXd> iterate(const Pencil& pencil, Index n_columns, Index n_wanted) {
  constexpr int kDepth = 3, kMaxIterations = 100;
  constexpr double kTolerance =
      1e-9;  // of an eigenvalue, what an iteration may change: the next changes less
  MatrixXd X = pencil.inverse(random_columns(pencil.n_rows, n_columns));
  VectorXd last;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Basis basis;
    basis.append(pencil, X);
    for (int depth = 1; depth < kDepth; ++depth) {
      const Index n_new = std::min<Index>(n_columns, basis.V.cols());
      basis.append(pencil, pencil.inverse(basis.MV.rightCols(n_new)));
    }
    const Eigen::SelfAdjointEigenSolver<MatrixXd> ritz(products(pencil, basis.V, pencil.stiffness(basis.V)));
    const Index n = std::min(n_columns, basis.V.cols());
    X = basis.V * ritz.eigenvectors().leftCols(n);
    const VectorXd now = ritz.eigenvalues().head(std::min(n_wanted, n));
    if (last.size() == now.size() &&
        ((now - last).cwiseAbs().array() <= kTolerance * now.array().abs() + pencil.zero / 10).all())
      return {ritz.eigenvalues().head(n), X};
    last = now;
  }
  throw std::runtime_error("natural frequencies: the block iteration has not converged");
}

}  // namespace

Pencil with_roots(const Pencil& pencil, const MatrixXd& U) {
  const MatrixXd Z = pencil.inverse(U);
  const MatrixXd capacitance = MatrixXd::Identity(U.cols(), U.cols()) + products(pencil, U, Z);
  Pencil with = pencil;
  with.stiffness = [=](const MatrixXd& x) -> MatrixXd {
    return pencil.stiffness(x) + U * products(pencil, U, x);
  };
  with.inverse = [=, factor = capacitance.ldlt()](const MatrixXd& b) -> MatrixXd {
    const MatrixXd y = pencil.inverse(b);
    return y - Z * factor.solve(products(pencil, U, y));
  };
  return with;
}

LowestModes lowest_modes(const Pencil& pencil, int n) {
  constexpr int kRigid = 6, kGuard = 6;
  for (Index n_zero = kRigid;;) {
    const Index n_wanted = n + n_zero;
    const auto [eigenvalues, X] = iterate(pencil, n_wanted + kGuard, n_wanted);
    const Index found = (eigenvalues.array() < pencil.zero).count();
    const bool has_all = eigenvalues.size() < n_wanted + kGuard;
    if (found <= n_zero || has_all) {
      const Index n_found = std::min<Index>(n, eigenvalues.size() - found);
      return {eigenvalues.segment(found, n_found), X.middleCols(found, n_found), static_cast<int>(found)};
    }
    n_zero = found == n_wanted + kGuard ? 2 * found : found;
  }
}

}  // namespace testbed::meshing
