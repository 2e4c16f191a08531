#include "massspring/model/small_strain.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "massspring/model/model.h"
#include "meshing/algebra/subdomains.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/// Calls visit(s, a, b, L - r) for the springs whose rest length r differs from their length L at rest.
template <class Visit>
void for_each_shrunk_spring(const MassSpringModel& model, const State& state, const Visit& visit) {
  if (!model.springs) return;
  const Eigen::VectorXd& rest = model.linear->rest_length;
  for (Eigen::Index s = 0; s < rest.size(); ++s)
    if (state.rest_length(s) != rest(s))
      visit(s, model.springs->E(0, s), model.springs->E(1, s), rest(s) - state.rest_length(s));
}

/// Calls visit(p, 1 - scale) for the patches whose rest shape has shrunk.
template <class Visit>
void for_each_shrunk_patch(const State& state, const Visit& visit) {
  for (Eigen::Index p = 0; p < state.patch_scale.size(); ++p)
    if (state.patch_scale(p) != 1) visit(static_cast<int>(p), 1 - state.patch_scale(p));
}

/// y -= K u.
void subtract_product(const MassSpringModel& model, const Matrix3Xd& u, Matrix3Xd& y) {
  if (model.tet_springs) add_linear_forces(*model.tet_springs, u, y);
  const BlockMatrix& K = model.linear->K;
  for_each_chunk(K.rows(), [&](Eigen::Index begin, Eigen::Index end) {
    for (Eigen::Index i = begin; i < end; ++i) {
      Vector3d sum = Vector3d::Zero();
      for (int k = K.row_start[i]; k < K.row_start[i + 1]; ++k) sum += K.block[k] * u.col(K.column[k]);
      y.col(i) -= sum;
    }
  });
}

Matrix3d edges_of(const Matrix3Xd& x, const Eigen::Vector4i& t) {
  return x(Eigen::all, t.tail<3>()).colwise() - x.col(t[0]);
}

/// Largest |principal value| of the symmetric part of a gradient, or something smaller if it is below what is known.
double principal_value(const Matrix3d& gradient, double known) {
  const Matrix3d strain = (gradient + gradient.transpose()) / 2;
  if (strain.norm() <= known) return 0;  // no eigenvalue is larger
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(strain, Eigen::EigenvaluesOnly);
  return eigen.eigenvalues().cwiseAbs().maxCoeff();
}

}  // namespace

void linearise(MassSpringModel& model) {
  const State rest = initial_state(model);
  auto linear = std::make_shared<LinearElasticity>();
  std::optional<TetSprings> coupled;
  coupled.swap(model.tet_springs);
  if (n_energies(model) > 0) {
    linear->K = stiffness_pattern(model);
    add_stiffness(model, rest, linear->K, Curvature::Exact);  // no negative eigenvalues at rest
  }
  coupled.swap(model.tet_springs);
  linear->rest_length = rest.rest_length;
  model.linear = std::move(linear);
}

void multiply_stiffness(const MassSpringModel& model, const Matrix3Xd& u, Matrix3Xd& y) {
  y = Matrix3Xd::Zero(3, u.cols());
  subtract_product(model, u, y);
  y = -y;
}

void add_diagonal(const MassSpringModel& model, double factor, std::vector<Matrix3d>& blocks) {
  if (model.tet_springs) add_diagonal(*model.tet_springs, factor, blocks);
  const BlockMatrix& K = model.linear->K;
  for (int i = 0; i < K.rows(); ++i) blocks[i] += factor * K.block[K.diagonal[i]];
}

Eigen::VectorXd row_sums(const MassSpringModel& model) {
  Eigen::VectorXd sums = Eigen::VectorXd::Zero(model.network.X.cols());
  if (model.tet_springs) add_row_sums(*model.tet_springs, sums);
  const BlockMatrix& K = model.linear->K;
  for (int i = 0; i < K.rows(); ++i)
    for (int k = K.row_start[i]; k < K.row_start[i + 1]; ++k) sums[i] += K.block[k].norm();
  return sums;
}

SingleStiffness single_stiffness(const MassSpringModel& model) {
  SingleStiffness single;
  if (model.linear->K.rows() > 0) single.K = single_precision(model.linear->K);
  if (model.tet_springs) single.patches = single_precision(*model.tet_springs);
  return single;
}

double add_product(const MassSpringModel& model, const SingleStiffness& single, const PaddedField& p,
                   PaddedField& y) {
  if (model.tet_springs) add_product(*model.tet_springs, single.patches, p, y);
  if (model.linear->K.rows() > 0) return add_product(model.linear->K, single.K, p, y);
  return dot(p, y);
}

double linear_energy(const MassSpringModel& model, const State& state, const Matrix3Xd& u) {
  Matrix3Xd Ku, g = Matrix3Xd::Zero(3, u.cols());
  multiply_stiffness(model, u, Ku);
  add_shrinkage_forces(model, state, g);
  double sum = u.cwiseProduct(Ku / 2 - g).sum();
  for_each_shrunk_spring(model, state, [&](Eigen::Index s, int, int, double shrinkage) {
    sum += model.springs->stiffness(s) / 2 * shrinkage * shrinkage;
  });
  for_each_shrunk_patch(state, [&](int p, double shrinkage) {
    const TetSprings& springs = *model.tet_springs;
    sum += 1.5 * (2 * springs.mu + 3 * springs.lambda[p]) * springs.volume[p] * shrinkage * shrinkage;
  });
  return sum;
}

void add_shrinkage_forces(const MassSpringModel& model, const State& state, Matrix3Xd& f) {
  const Matrix3Xd& X = model.network.X;
  for_each_shrunk_spring(model, state, [&](Eigen::Index s, int a, int b, double shrinkage) {
    const Vector3d pull =
        model.springs->stiffness(s) * shrinkage / model.linear->rest_length(s) * (X.col(b) - X.col(a));
    f.col(a) += pull;
    f.col(b) -= pull;
  });
  for_each_shrunk_patch(state, [&](int p, double shrinkage) {
    const TetSprings& springs = *model.tet_springs;
    const double stress = (2 * springs.mu + 3 * springs.lambda[p]) * shrinkage;
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
      f.col(springs.node[e]) -= stress * springs.volume[p] * springs.b(p, e);
  });
}

void add_linear_forces(const MassSpringModel& model, const State& state, const Matrix3Xd& u, Matrix3Xd& f) {
  add_shrinkage_forces(model, state, f);
  subtract_product(model, u, f);
}

double largest_linear_strain(const Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Matrix3Xd& u) {
  double largest = 0;
  for (const auto& t : T.colwise())
    largest = std::max(largest, principal_value(edges_of(u, t) * edges_of(X, t).inverse(), largest));
  return largest;
}

double largest_mean_strain(const Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Matrix3Xd& u) {
  std::vector<Matrix3d> gradient(X.cols(), Matrix3d::Zero());
  Eigen::VectorXd volume = Eigen::VectorXd::Zero(X.cols());  // six times that
  for (const auto& t : T.colwise()) {
    const Matrix3d rest = edges_of(X, t);
    Matrix3d adjugate;  // of tetrahedra without volume, too
    for (int k = 0; k < 3; ++k) adjugate.row(k) = rest.col((k + 1) % 3).cross(rest.col((k + 2) % 3));
    const Matrix3d sum = edges_of(u, t) * adjugate;
    for (const int i : t) {
      gradient[i] += sum;
      volume(i) += rest.determinant();
    }
  }
  double largest = 0;
  for (Eigen::Index i = 0; i < X.cols(); ++i)
    if (volume(i) != 0) largest = std::max(largest, principal_value(gradient[i] / volume(i), largest));
  return largest;
}

double largest_linear_strain(const Matrix3Xd& X, const Eigen::Matrix2Xi& E, const Matrix3Xd& u) {
  double largest = 0;
  for (const auto& s : E.colwise()) {
    const Vector3d l = X.col(s(0)) - X.col(s(1));
    largest = std::max(largest, std::abs(l.dot(u.col(s(0)) - u.col(s(1)))) / l.squaredNorm());
  }
  return largest;
}

}  // namespace testbed::massspring
