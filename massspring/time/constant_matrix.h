// The matrix of implicit steps of a linear model, which stays while their length does.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "massspring/time/implicit_matrix.h"

namespace testbed::massspring {

/// Nothing but linear forces acts: steps solve linear systems of one matrix.
bool is_linear(const EquationOfMotion& motion);

/// A = mass M + stiffness K + damping D about rest on the free directions. Where steps keep their length and
/// its fill is affordable it is factorised, once; else systems are solved by LinearSolver.
class ConstantMatrix {
 public:
  static constexpr double kTolerance = 1e-10;  ///< of iterations, relative to what a guess leaves

  /// @param A       whatever was set is lost
  /// @param solver  for systems that are not factorised
  /// @param keeps_step  its factors change but once or twice
  /// @param most_blocks  that are factorised. Of coupled springs, 12,000 nodes have 7e5, whose factor takes
  /// 0.7 GB.
  ConstantMatrix(const EquationOfMotion& motion, ImplicitMatrix& A, LinearSolver& solver, bool keeps_step,
                 std::size_t most_blocks = 800'000);

  /// Solves A x = b (3 x n) on the free directions, b filtered.
  SolveReport solve(const ImplicitMatrix::Factors& factors, const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x);

  const std::string& choice() const { return factor_ ? choice_ : solver_.choice(); }

 private:
  const EquationOfMotion& motion_;
  ImplicitMatrix& A_;
  LinearSolver& solver_;
  bool is_factored_;
  std::optional<ImplicitMatrix::Factors> factors_;
  std::unique_ptr<BlockCholesky> factor_;
  std::string choice_ = "Cholesky factor: small strain, one matrix for all steps";
};

}  // namespace testbed::massspring
