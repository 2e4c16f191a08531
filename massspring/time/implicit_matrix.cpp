#include "massspring/time/implicit_matrix.h"

#include <cmath>

#include "meshing/surface/surface.h"

namespace testbed::massspring {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;

namespace {

std::unique_ptr<MassSpringModel> without(const MassSpringModel& model, const Gradients& gradients) {
  if ((gradients.volume || !model.local_volume) && (gradients.bending || !model.bending)) return {};
  auto reduced = std::make_unique<MassSpringModel>(model);
  if (!gradients.volume) reduced->local_volume.reset();
  if (!gradients.bending) reduced->bending.reset();
  return reduced;
}

}  // namespace

ImplicitMatrix::ImplicitMatrix(const EquationOfMotion& motion, const Gradients& gradients)
    : motion_(motion),
      has_volume_(gradients.volume),
      reduced_(without(motion.model, gradients)),
      model_(reduced_ ? *reduced_ : motion.model) {
  if (is_springs_alone(model_))
    rows_.emplace(model_.springs->E, static_cast<int>(model_.mass.size()));
  else
    K_ = stiffness_pattern(model_);
}

void ImplicitMatrix::set(const State& at, const Matrix3Xd& damped_at, const Factors& factors,
                         Curvature curvature) {
  single_.reset();
  mass_ = factors.mass * model_.mass;
  if (model_.springs && model_.springs->damping > 0)
    damping_ = damping_matrix(*model_.springs, motion_.damped_at(damped_at), factors.damping);
  x_ = at.x;
  surface_ = motion_.surface_hessian(at, curvature);
  if (!has_volume_) surface_.roots.clear();
  surface_.scale(factors.stiffness);
  if (!K_) {
    springs_ = hessian(*model_.springs, at.rest_length, at.x, factors.stiffness, curvature);
    return;
  }
  K_->set_zero();
  add_stiffness(model_, at, *K_, curvature);
  for (Matrix3d& block : K_->block) block *= factors.stiffness;
  if (damping_) add_blocks(*model_.springs, *damping_, *K_);
  for (int i = 0; i < K_->rows(); ++i) K_->block[K_->diagonal[i]].diagonal().array() += mass_(i);
  if (model_.consistent_mass) add_blocks(*model_.consistent_mass, -factors.mass, *K_);
}

void ImplicitMatrix::multiply(const Matrix3Xd& p, Matrix3Xd& y) const {
  if (K_) {
    meshing::multiply(*K_, p, y);
  } else {
    y = p * mass_.asDiagonal();
    add_product(*model_.springs, *springs_, p, y);
    if (damping_) add_product(*model_.springs, *damping_, p, y);
  }
  surface_.add_product(p, y);
  filter(motion_.constraints, y);
}

void ImplicitMatrix::make_single() {
  single_.emplace();
  single_->mass = mass_.cast<float>();
  if (springs_) single_->springs = rows_->in_rows(*springs_);
  if (springs_ && damping_) single_->damping = rows_->in_rows(*damping_);
  if (K_) single_->K = single_precision(*K_);
  single_->roots = surface_.single_roots();
}

double ImplicitMatrix::multiply_single(const PaddedField& p, PaddedField& y) {
  if (!single_) make_single();
  const SinglePrecision& A = *single_;
  if (K_)
    y.setZero(4, p.cols());
  else
    meshing::multiply(A.mass, p, y);
  surface_.add_product(A.roots, p, y);
  double p_Ap;
  if (K_) {
    p_Ap = add_product(*K_, A.K, p, y);
  } else {
    if (damping_) rows_->add_product(A.damping, p, y);
    p_Ap = rows_->add_product(A.springs, p, y);
  }
  filter_single(y);
  return p_Ap;
}

void ImplicitMatrix::filter_single(PaddedField& y) const {
  for (const Constraint& c : motion_.constraints)
    y.col(c.node).head<3>() = c.S.cast<float>() * y.col(c.node).head<3>().eval();
}

void ImplicitMatrix::diagonal(std::vector<Matrix3d>& blocks) const {
  const int n = static_cast<int>(mass_.size());
  blocks.resize(n);
  if (K_) {
    for (int i = 0; i < n; ++i) blocks[i] = K_->block[K_->diagonal[i]];
  } else {
    for (int i = 0; i < n; ++i) blocks[i] = mass_(i) * Matrix3d::Identity();
    add_diagonal(*model_.springs, *springs_, blocks);
    if (damping_) add_diagonal(*model_.springs, *damping_, blocks);
  }
  surface_.add_diagonal(blocks);
  for (const Constraint& c : motion_.constraints) {
    Matrix3d& block = blocks[c.node];
    block = c.S * block * c.S + block.trace() * (Matrix3d::Identity() - c.S);
  }
}

const BlockMatrix& ImplicitMatrix::matrix() {
  if (K_) {
    A_ = *K_;
  } else {
    if (!A_) A_ = stiffness_pattern(model_);
    A_->set_zero();
    for (int i = 0; i < A_->rows(); ++i) A_->block[A_->diagonal[i]].diagonal().setConstant(mass_(i));
    add_blocks(*model_.springs, *springs_, *A_);
    if (damping_) add_blocks(*model_.springs, *damping_, *A_);
  }
  surface_.add_within(*A_);
  filter(motion_.constraints, *A_);
  return *A_;
}

LinearSystem ImplicitMatrix::system() {
  return {[this](const Matrix3Xd& p, Matrix3Xd& y) { multiply(p, y); },
          [this](const PaddedField& p, PaddedField& y) { return multiply_single(p, y); },
          [this](Matrix3Xd& y) { filter(motion_.constraints, y); },
          [this](PaddedField& y) { filter_single(y); },
          [this](std::vector<Matrix3d>& blocks) { diagonal(blocks); },
          [this]() -> const BlockMatrix& { return matrix(); },
          &x_};
}

}  // namespace testbed::massspring
