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
      model_(reduced_ ? *reduced_ : motion.model),
      is_linear_(model_.linear && model_.tet_springs && !(model_.springs && model_.springs->damping > 0)) {
  if (is_springs_alone(model_))
    rows_.emplace(model_.springs->E, static_cast<int>(model_.mass.size()));
  else if (!is_linear_)
    K_ = stiffness_pattern(model_);
}

void ImplicitMatrix::assemble(const State& at, Curvature curvature, BlockMatrix& A) const {
  A.set_zero();
  add_stiffness(model_, at, A, curvature);
  complete(A);
}

/// Makes of a stiffness the matrix, but for the surface and constraints.
void ImplicitMatrix::complete(BlockMatrix& A) const {
  for (Matrix3d& block : A.block) block *= factors_.stiffness;
  if (damping_) {
    add_blocks(*model_.springs, *damping_, A);
    mirror(A);
  }
  for (int i = 0; i < A.rows(); ++i) A.block[A.diagonal[i]].diagonal().array() += mass_(i);
  if (model_.consistent_mass) add_blocks(*model_.consistent_mass, -factors_.mass, A);
}

void ImplicitMatrix::set(const State& at, const Matrix3Xd& damped_at, const Factors& factors,
                         Curvature curvature) {
  single_.reset();
  factors_ = factors;
  mass_ = factors.mass * model_.mass;
  if (model_.springs && model_.springs->damping > 0)
    damping_ = damping_matrix(*model_.springs, motion_.damped_at(damped_at), factors.damping);
  x_ = at.x;
  surface_ = motion_.surface_hessian(at, curvature);
  if (!has_volume_) surface_.roots.clear();
  surface_.scale(factors.stiffness);
  if (K_)
    assemble(at, curvature, *K_);
  else if (!is_linear_)
    springs_ = hessian(*model_.springs, at.rest_length, at.x, factors.stiffness, curvature);
}

void ImplicitMatrix::multiply(const Matrix3Xd& p, Matrix3Xd& y) const {
  if (K_) {
    meshing::multiply(*K_, p, y);
  } else if (is_linear_) {
    multiply_stiffness(model_, p, y);
    y = factors_.stiffness * y + p * mass_.asDiagonal();
    if (model_.consistent_mass) add_product(*model_.consistent_mass, -factors_.mass, p, y);
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
  if (is_linear_ && !stiffness_) stiffness_ = single_stiffness(model_);
  single_->roots = surface_.single_roots();
}

double ImplicitMatrix::multiply_single(const PaddedField& p, PaddedField& y) {
  if (!single_) make_single();
  const SinglePrecision& A = *single_;
  if (K_) {
    y.setZero(4, p.cols());
  } else if (is_linear_) {
    y.setZero(4, p.cols());
    add_product(model_, *stiffness_, p, y);
    y *= static_cast<float>(factors_.stiffness);
    y.leftCols(mass_.size()) += p.leftCols(mass_.size()) * A.mass.asDiagonal();
    if (model_.consistent_mass) add_product(*model_.consistent_mass, -factors_.mass, p, y);
  } else {
    meshing::multiply(A.mass, p, y);
  }
  surface_.add_product(A.roots, p, y);
  double p_Ap;
  if (K_) {
    p_Ap = add_product(*K_, A.K, p, y);
  } else if (is_linear_) {
    p_Ap = dot(p, y);
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
    if (is_linear_) add_diagonal(model_, factors_.stiffness, blocks);
    if (is_linear_ && model_.consistent_mass) add_diagonal(*model_.consistent_mass, -factors_.mass, blocks);
    if (springs_) add_diagonal(*model_.springs, *springs_, blocks);
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
  } else if (is_linear_) {
    A_ = stiffness_pattern(model_);
    assemble({}, Curvature::Exact, *A_);
  } else {
    if (!A_) A_ = stiffness_pattern(model_);
    A_->set_zero();
    for (int i = 0; i < A_->rows(); ++i) A_->block[A_->diagonal[i]].diagonal().setConstant(mass_(i));
    add_blocks(*model_.springs, *springs_, *A_);
    if (damping_) add_blocks(*model_.springs, *damping_, *A_);
    mirror(*A_);
  }
  surface_.add_within(*A_);
  filter(motion_.constraints, *A_);
  return *A_;
}

/// Of many nodes of a linear model that of single tetrahedra, which has a fraction of the blocks.
const BlockMatrix& ImplicitMatrix::preconditioning_matrix() {
  constexpr Eigen::Index kFewNodes = 5000;
  if (!is_linear_ || n_energies(model_) > 1 || mass_.size() <= kFewNodes || model_.material.nu > kLocks)
    return matrix();
  A_ = simple_stiffness(model_, initial_state(model_));
  complete(*A_);
  surface_.add_within(*A_);
  filter(motion_.constraints, *A_);
  return *A_;
}

LinearSystem ImplicitMatrix::system() {
  const auto constrain = [this](Matrix3Xd& y) { filter(motion_.constraints, y); };
  return {[this](const Matrix3Xd& p, Matrix3Xd& y) { multiply(p, y); },
          [this](const PaddedField& p, PaddedField& y) { return multiply_single(p, y); },
          constrain,
          constrain,
          [this](PaddedField& y) { filter_single(y); },
          [this](std::vector<Matrix3d>& blocks) { diagonal(blocks); },
          [this]() -> const BlockMatrix& { return preconditioning_matrix(); },
          &x_};
}

}  // namespace testbed::massspring
