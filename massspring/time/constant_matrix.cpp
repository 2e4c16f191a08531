#include "massspring/time/constant_matrix.h"

#include <stdexcept>

namespace testbed::massspring {

using Eigen::Matrix3Xd;

constexpr int kMostNodes = 30'000;  // beyond, fill outgrows patience

bool is_linear(const EquationOfMotion& motion) {
  return motion.model.linear && motion.contacts.bodies.empty() && motion.surface().empty();
}

ConstantMatrix::ConstantMatrix(const EquationOfMotion& motion, ImplicitMatrix& A, LinearSolver& solver,
                               bool keeps_step, std::size_t most_blocks)
    : motion_(motion),
      A_(A),
      solver_(solver),
      is_factored_(keeps_step && motion.model.mass.size() <= kMostNodes &&
                   static_cast<std::size_t>(n_stiffness_blocks(motion.model)) <= most_blocks) {}

SolveReport ConstantMatrix::solve(const ImplicitMatrix::Factors& factors, const Matrix3Xd& b, Matrix3Xd& x) {
  if (!factors_ || !(*factors_ == factors)) {
    const State rest = initial_state(motion_.model);
    A_.set(rest, rest.x, factors, Curvature::Exact);
    factors_ = factors;
    if (factor_)
      factor_->update(A_.matrix());
    else if (is_factored_)
      factor_ = std::make_unique<BlockCholesky>(A_.matrix());
    if (factor_ && !factor_->is_ok())
      throw std::runtime_error(
          "the matrix of a step has no Cholesky factor, expected a positive definite model");
  }
  if (!factor_) {
    x = Matrix3Xd::Zero(3, b.cols());
    return solver_.solve(A_.system(), b, x, kTolerance);
  }
  factor_->solve(b, x);
  SolveReport report;
  report.is_converged = x.allFinite();
  return report;
}

}  // namespace testbed::massspring
