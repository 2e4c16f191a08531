#include "massspring/implicit_matrix.h"

#include <cmath>

#include "meshing/surface.h"

namespace testbed {

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

ImplicitMatrix::ImplicitMatrix(const Motion& motion, const Gradients& gradients)
    : motion_(motion),
      has_volume_(gradients.volume),
      reduced_(without(motion.model, gradients)),
      model_(reduced_ ? *reduced_ : motion.model) {
  if (!is_springs_alone(model_)) K_ = stiffness_pattern(model_);
}

void ImplicitMatrix::set(const State& at, const Matrix3Xd& damped_at, const Factors& factors,
                         Curvature curvature) {
  mass_ = factors.mass * model_.mass;
  if (model_.springs && model_.springs->damping > 0)
    damping_ = damping_matrix(*model_.springs, damped_at, factors.damping);
  if (has_volume_) g_ = volume_stiffness_root(model_, motion_.forces, at);
  if (g_) *g_ *= std::sqrt(factors.stiffness);
  volume_curvature_.clear();
  if (curvature == Curvature::Exact) {
    volume_curvature_ = volume_curvatures(model_, motion_.forces, at);
    for (VolumeCurvature& c : volume_curvature_) c.factor *= factors.stiffness;
  }
  x_ = at.x;
  if (motion_.barrier) {
    contact_.assign(mass_.size(), Matrix3d::Zero());
    motion_.barrier->add_hessian(at.x, contact_);
  }
  if (motion_.self_contact) {
    pairs_ = motion_.self_contact->touching(at.x);
    for (NearPair& pair : pairs_) pair.stiffness *= factors.stiffness;
  }
  if (!K_) {
    springs_ = hessian(*model_.springs, at.rest_length, at.x, factors.stiffness, curvature);
    return;
  }
  K_->set_zero();
  add_stiffness(model_, at, *K_, curvature);
  for (Matrix3d& block : K_->block) block *= factors.stiffness;
  if (damping_) add_blocks(*model_.springs, *damping_, *K_);
  for (int i = 0; i < K_->rows(); ++i) K_->block[K_->diagonal[i]].diagonal().array() += mass_(i);
  if (model_.spread_mass) add_blocks(*model_.spread_mass, -factors.mass, *K_);
}

void ImplicitMatrix::multiply_sparse(const Matrix3Xd& p, Matrix3Xd& y) const {
  if (K_) {
    testbed::multiply(*K_, p, y);
  } else {
    y = p * mass_.asDiagonal();
    add_product(*model_.springs, *springs_, p, y);
    if (damping_) add_product(*model_.springs, *damping_, p, y);
  }
  for (size_t i = 0; i < contact_.size(); ++i) y.col(i) += contact_[i] * p.col(i);
  for (const NearPair& pair : pairs_) {
    double closing = 0;
    for (int a = 0; a < 4; ++a) closing += pair.weight[a] * pair.normal.dot(p.col(pair.node[a]));
    for (int a = 0; a < 4; ++a)
      y.col(pair.node[a]) += pair.stiffness * closing * pair.weight[a] * pair.normal;
  }
}

void ImplicitMatrix::multiply(const Matrix3Xd& p, Matrix3Xd& y) const {
  multiply_sparse(p, y);
  if (g_) y += g_->cwiseProduct(p).sum() * *g_;
  for (const auto& [factor, F] : volume_curvature_) add_volume_curvature(factor, *F, x_, p, y);
  filter(motion_.constraints, y);
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
  for (size_t i = 0; i < contact_.size(); ++i) blocks[i] += contact_[i];
  for (const NearPair& pair : pairs_)
    for (int a = 0; a < 4; ++a)
      blocks[pair.node[a]] +=
          pair.stiffness * pair.weight[a] * pair.weight[a] * pair.normal * pair.normal.transpose();
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
  for (size_t i = 0; i < contact_.size(); ++i) A_->block[A_->diagonal[i]] += contact_[i];
  filter(motion_.constraints, *A_);
  return *A_;
}

LinearSystem ImplicitMatrix::system() {
  return {[this](const Matrix3Xd& p, Matrix3Xd& y) { multiply(p, y); },
          [this](const Matrix3Xd& p, Matrix3Xd& y) {
            multiply_sparse(p, y);
            filter(motion_.constraints, y);
          },
          [this](Matrix3Xd& y) { filter(motion_.constraints, y); },
          [this](std::vector<Matrix3d>& blocks) { diagonal(blocks); },
          [this]() -> const BlockMatrix& { return matrix(); },
          &x_};
}

}  // namespace testbed
