// The factor that Newton's method keeps over steps that change little.
#pragma once

#include <functional>
#include <optional>

#include "massspring/time/implicit_matrix.h"

namespace testbed::massspring {

/// A Cholesky factor in single precision of the matrix of some iteration. It stands for those of later
/// iterations and steps, which form no matrix then, while each makes the gradient fall to 0.3 of itself. Where
/// a new one does no better, the step is left to others; after many of these, every step.
class KeptFactor {
 public:
  /// @param keeps_step  steps have one length
  KeptFactor(const EquationOfMotion& motion, bool keeps_step);

  /// A step begins.
  void begin();
  /// dx = A^-1 r, both 3 x n, r filtered.
  /// @param set  sets A with these factors at the present state, if it is to be factorised
  /// @returns false, with dx as it was, where it does not serve.
  bool solve(const Eigen::Matrix3Xd& r, const ImplicitMatrix::Factors& factors,
             const std::function<void(Curvature curvature)>& set, ImplicitMatrix& A, Eigen::Matrix3Xd& dx);

  /// What is kept over steps.
  friend void archive(meshing::Archive& a, KeptFactor& kept) {
    ImplicitMatrix::Factors& factors = kept.factors_;
    a(kept.credit_, kept.is_sound_, factors.mass, factors.stiffness, factors.damping, kept.single_);
  }

  bool is_in_use() const { return is_sound_ && credit_ > 0; }

 private:
  void renew(const std::function<void(Curvature curvature)>& set, ImplicitMatrix& A);

  int credit_;  // what it has spared less what it has cost; used up, it is not tried
  bool is_sound_ = false, is_new_ = false,
       is_out_ = false;  // exists, made in this step, given up in this step
  double before_ = 0;    // size of the last gradient
  ImplicitMatrix::Factors factors_{};
  std::optional<BlockCholesky> cholesky_;
  SinglePrecisionFactor single_;
};

}  // namespace testbed::massspring
