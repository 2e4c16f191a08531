#include "massspring/statics/linear_statics.h"

#include <Eigen/Geometry>
#include <stdexcept>

namespace testbed::massspring {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

Matrix3d without(const Vector3d& direction) {
  return Matrix3d::Identity() - direction * direction.transpose();
}

BlockMatrix stiffness_at_rest(const MassSpringModel& model, const std::vector<Constraint>& constraints) {
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, initial_state(model), K, Curvature::Exact);  // no negative eigenvalues at rest
  filter(constraints, K);
  return K;
}

using Preconditioner = std::variant<BlockCholesky, Multigrid>;

/// Of K, the model's stiffness, or where coupled springs are not P1 already of that of single tetrahedra.
Preconditioner preconditioner_of(const MassSpringModel& model, const std::vector<Constraint>& constraints,
                                 const BlockMatrix& K) {
  constexpr Eigen::Index kFewNodes = 5000;  // beyond, a factor takes longer than it saves
  const auto& [X, T, F, n_surface] = model.network;
  const auto filter_field = [constraints](Matrix3Xd& y) { filter(constraints, y); };
  const auto of = [&](const BlockMatrix& A) {
    if (model.springs || X.cols() <= kFewNodes) return Preconditioner(std::in_place_type<BlockCholesky>, A);
    return Preconditioner(std::in_place_type<Multigrid>, A, X, filter_field);
  };
  if (model.springs || !model.tet_springs || model.tet_springs->n_patches() == T.cols()) return of(K);
  BlockMatrix simple = simple_stiffness(model, initial_state(model));
  filter(constraints, simple);
  return of(simple);
}

/// z = a preconditioner's answer to r, whose scale single precision may not hold.
void apply(Multigrid& multigrid, const Matrix3Xd& r, Matrix3Xd& z) {
  const double scale = r.norm();
  z = Matrix3Xd::Zero(3, r.cols());
  if (scale == 0) return;
  PaddedField single, answer;
  pad(r, 1 / scale, single);
  multigrid.apply(single, answer);
  add_unpadded(answer, scale, z);
}

}  // namespace

std::vector<Constraint> hold_rigid_motion(const Matrix3Xd& X) {
  Eigen::Index a, b, c;  // far from the centre; farthest from a; farthest from the line ab
  (X.colwise() - X.rowwise().mean().eval()).colwise().squaredNorm().maxCoeff(&a);
  const Matrix3Xd from_a = X.colwise() - X.col(a);
  from_a.colwise().squaredNorm().maxCoeff(&b);
  const Vector3d along = from_a.col(b).normalized();
  (without(along) * from_a).colwise().squaredNorm().maxCoeff(&c);
  const Vector3d normal = along.cross(from_a.col(c)).normalized(), none = Vector3d::Zero();
  return {{static_cast<int>(a), Matrix3d::Zero(), none},
          {static_cast<int>(b), along * along.transpose(), none},
          {static_cast<int>(c), without(normal), none}};
}

LinearStatics::LinearStatics(const MassSpringModel& model, const std::vector<Constraint>& constraints)
    : constraints_(constraints),
      K_(stiffness_at_rest(model, constraints)),
      preconditioner_(preconditioner_of(model, constraints, K_)) {
  const auto* factor = std::get_if<BlockCholesky>(&preconditioner_);
  if (factor && !factor->is_ok())
    throw std::runtime_error(
        "the stiffness is not positive definite: too few directions are constrained, or the network is "
        "floppy");
}

SolveReport LinearStatics::solve(const Matrix3Xd& f, Matrix3Xd& u, double tolerance) {
  constexpr int kMaxIterations = 2000;
  Matrix3Xd load = f;
  filter(constraints_, load);
  u = Matrix3Xd::Zero(3, f.cols());
  const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) {
    if (const auto* factor = std::get_if<BlockCholesky>(&preconditioner_))
      factor->solve(r, z);
    else
      apply(std::get<Multigrid>(preconditioner_), r, z);
  };
  return conjugate_gradients([&](const Matrix3Xd& p, Matrix3Xd& y) { multiply(K_, p, y); }, precondition,
                             load, u, tolerance, kMaxIterations);
}

}  // namespace testbed::massspring
