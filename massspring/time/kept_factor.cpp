#include "massspring/time/kept_factor.h"

#include <algorithm>
#include <limits>

namespace testbed::massspring {

namespace {

constexpr int kCost = 10;      // of a factorisation, in steps that it serves
constexpr int kPatience = 50;  // of its cost that may be in vain

/// Matrices of springs alone cost less than what they spare; and what a factorised matrix does not hold would
/// make its directions poor.
bool is_eligible(const EquationOfMotion& motion) {
  const auto is_left_out = [](const auto& energy) {
    return energy->is_stiff() || energy->holding_pressure();
  };
  const SurfaceEnergies surface = motion.surface();
  return !is_springs_alone(motion.model) && motion.contacts.bodies.empty() && !motion.forces.volume &&
         std::none_of(surface.begin(), surface.end(), is_left_out);
}

}  // namespace

KeptFactor::KeptFactor(const EquationOfMotion& motion, bool keeps_step)
    : credit_(keeps_step && is_eligible(motion) ? kPatience : 0) {}

void KeptFactor::begin() {
  is_new_ = is_out_ = false;
  before_ = std::numeric_limits<double>::infinity();
  if (credit_ > 0) ++credit_;
}

void KeptFactor::renew(const std::function<void(Curvature curvature)>& set, ImplicitMatrix& A) {
  constexpr std::size_t kMostBlocks = 800'000;  // as ConstantMatrix
  is_sound_ = false;
  set(Curvature::Exact);
  const BlockMatrix& matrix = A.matrix();
  if (matrix.block.size() > kMostBlocks) credit_ = 0;
  if (credit_ <= 0) return;
  credit_ -= kCost;
  if (cholesky_)
    cholesky_->update(matrix);
  else
    cholesky_.emplace(matrix);
  is_sound_ = cholesky_->is_ok();
  if (is_sound_) single_ = cholesky_->single_precision();
}

bool KeptFactor::solve(const Eigen::Matrix3Xd& r, const ImplicitMatrix::Factors& factors,
                       const std::function<void(Curvature curvature)>& set, ImplicitMatrix& A,
                       Eigen::Matrix3Xd& dx) {
  constexpr double kSlow = 0.3;
  if (credit_ <= 0 || is_out_) return false;
  const double size = r.norm();
  const bool serves = is_sound_ && factors == factors_ && size <= kSlow * before_;
  before_ = size;
  factors_ = factors;
  if (!serves) {
    is_out_ = is_new_;
    if (!is_out_) renew(set, A);
    is_new_ = true;
    if (is_out_ || !is_sound_) return false;
  }
  dx = single_.solve(r);
  return true;
}

}  // namespace testbed::massspring
