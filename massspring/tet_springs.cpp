#include "massspring/tet_springs.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace testbed {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Matrix4Xi;
using Eigen::Vector3d;
using Matrix9d = Eigen::Matrix<double, 9, 9>;
using TetGradients = Eigen::Matrix<double, 3, 4>;

constexpr double least_jacobian = 0.1;  // J_0 of the law

/// Gradients of the four barycentric coordinates (1/m).
TetGradients barycentric_gradients(const Matrix3Xd& X, const Eigen::Vector4i& t) {
  Matrix3d edges;
  for (int k = 0; k < 3; ++k) edges.col(k) = X.col(t[k + 1]) - X.col(t[0]);
  TetGradients g;
  g.rightCols<3>() = edges.inverse().transpose();
  g.col(0) = -g.rightCols<3>().rowwise().sum();
  return g;
}

struct VolumeLaw {
  double g, dg, ddg;
};

/// g(J) of the law and its derivatives.
VolumeLaw volume_law(double J, double lambda, double mu) {
  const double c = mu + lambda / 2, j = std::max(J, least_jacobian);
  VolumeLaw law{lambda / 4 * (j * j - 1) - c * std::log(j), lambda / 2 * j - c / j, lambda / 2 + c / (j * j)};
  const double d = J - j;
  law.g += law.dg * d + law.ddg / 2 * d * d;
  law.dg += law.ddg * d;
  return law;
}

Matrix3d deformation_gradient(const TetSprings& springs, int patch, const Matrix3Xd& x) {
  Matrix3d F = Matrix3d::Zero();
  for (int e = springs.first[patch]; e < springs.first[patch + 1]; ++e)
    F += x.col(springs.node[e]) * springs.b.col(e).transpose();
  return F;
}

double scale_of(const Eigen::VectorXd& scale, int patch) {
  return scale.size() > 0 ? scale[patch] : 1;
}

Matrix3d cofactor(const Matrix3d& F) {
  Matrix3d C;
  C << F.col(1).cross(F.col(2)), F.col(2).cross(F.col(0)), F.col(0).cross(F.col(1));
  return C;
}

/// psi'' in the basis u_i v_j^T of F's singular vectors: a 3 x 3 block of stretches, and for each pair of
/// axes i, j a twist and a flip with eigenvalues mu +- g' s_k.
Matrix9d stiffness(const Matrix3d& F, double lambda, double mu, Curvature curvature) {
  const Eigen::JacobiSVD<Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3d U = svd.matrixU(), V = svd.matrixV();
  Vector3d s = svd.singularValues();
  if (U.determinant() * V.determinant() < 0) {
    U.col(2) *= -1;
    s[2] *= -1;
  }
  const VolumeLaw law = volume_law(s.prod(), lambda, mu);

  const Vector3d c(s[1] * s[2], s[2] * s[0], s[0] * s[1]);
  Matrix3d stretch = mu * Matrix3d::Identity() + law.ddg * c * c.transpose();
  const double least = curvature == Curvature::Projected ? 0 : -std::numeric_limits<double>::infinity();
  Matrix9d M = Matrix9d::Zero();
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    stretch(i, j) += law.dg * s[k];
    stretch(j, i) += law.dg * s[k];
    const double twist = std::max(mu + law.dg * s[k], least), flip = std::max(mu - law.dg * s[k], least);
    const int ij = i + 3 * j, ji = j + 3 * i;
    M(ij, ij) = M(ji, ji) = (twist + flip) / 2;
    M(ij, ji) = M(ji, ij) = (flip - twist) / 2;
  }
  if (curvature == Curvature::Projected) {
    const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(stretch);
    stretch = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() *
              eigen.eigenvectors().transpose();
  }
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) M(4 * i, 4 * j) = stretch(i, j);

  Matrix9d Q;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i)
      Eigen::Map<Matrix3d>(Q.col(i + 3 * j).data()) = U.col(i) * V.col(j).transpose();
  return Q * M * Q.transpose();
}

/// The 9 x 3 matrix that takes a node's displacement u to the columns of u b^T.
Eigen::Matrix<double, 9, 3> spread(const Vector3d& b) {
  Eigen::Matrix<double, 9, 3> B;
  for (int j = 0; j < 3; ++j) B.middleRows<3>(3 * j) = b[j] * Matrix3d::Identity();
  return B;
}

/// Number of each of a tetrahedron's six edges among all edges, 6 x m.
Eigen::MatrixXi edge_numbers(const Matrix4Xi& T) {
  std::vector<std::pair<int, int>> pairs;
  for (const auto& t : T.colwise())
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) pairs.emplace_back(std::minmax(t[i], t[j]));
  std::vector<std::pair<int, int>> edges = pairs;
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Eigen::MatrixXi numbers(6, T.cols());
  for (std::size_t k = 0; k < pairs.size(); ++k)
    numbers(k) = static_cast<int>(std::lower_bound(edges.begin(), edges.end(), pairs[k]) - edges.begin());
  return numbers;
}

/// Adds patches that average over tetrahedra: column t of `patches` names those that tetrahedron t belongs
/// to, each with an equal share of `part` of its volume.
void append_patches(const Matrix3Xd& X, const Matrix4Xi& T, const Eigen::MatrixXi& patches, double part,
                    double lambda, TetSprings& springs) {
  struct Entry {
    int patch, node;
    Vector3d b;
    double weight;
  };
  std::vector<Entry> entries;
  entries.reserve(4 * patches.size());
  const int n_before = springs.n_patches(), n_new = patches.maxCoeff() + 1;
  Eigen::VectorXd volume = Eigen::VectorXd::Zero(n_new);
  for (Eigen::Index t = 0; t < T.cols(); ++t) {
    const double share = part * rest_volume(X, T.col(t)) / static_cast<double>(patches.rows());
    const TetGradients gradients = barycentric_gradients(X, T.col(t));
    for (int p : patches.col(t)) {
      volume[p] += share;
      for (int k = 0; k < 4; ++k) entries.push_back({p, T(k, t), share * gradients.col(k), share / 4});
    }
  }
  std::stable_sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::pair(a.patch, a.node) < std::pair(b.patch, b.node);
  });

  const std::size_t n_entries = springs.node.size();
  const auto resize = [&](std::size_t n) {
    springs.b.conservativeResize(3, static_cast<Eigen::Index>(n));
    springs.weight.conservativeResize(static_cast<Eigen::Index>(n));
  };
  resize(n_entries + entries.size());
  for (std::size_t e = 0; e < entries.size(); ++e) {
    const auto& [patch, node, b, weight] = entries[e];
    const bool is_new_patch = e == 0 || patch != entries[e - 1].patch;
    if (e > 0 && is_new_patch) springs.first.push_back(static_cast<int>(springs.node.size()));
    if (is_new_patch || node != entries[e - 1].node) {
      springs.node.push_back(node);
      springs.b.col(static_cast<Eigen::Index>(springs.node.size()) - 1).setZero();
      springs.weight[static_cast<Eigen::Index>(springs.node.size()) - 1] = 0;
    }
    springs.b.col(static_cast<Eigen::Index>(springs.node.size()) - 1) += b / volume[patch];
    springs.weight[static_cast<Eigen::Index>(springs.node.size()) - 1] += weight / volume[patch];
  }
  springs.first.push_back(static_cast<int>(springs.node.size()));
  resize(springs.node.size());
  springs.volume.conservativeResize(n_before + n_new);
  springs.volume.tail(n_new) = volume;
  springs.lambda.conservativeResize(n_before + n_new);
  springs.lambda.tail(n_new).setConstant(lambda);
}

}  // namespace

Lame lame_of(const Material& material) {
  const double E = material.E, nu = material.nu;
  if (!(E > 0)) throw std::runtime_error("Young's modulus " + std::to_string(E) + " Pa, expected > 0");
  if (!(nu >= 0 && nu <= 0.499))
    throw std::runtime_error("Poisson's ratio " + std::to_string(nu) + ", expected 0 to 0.499");
  return {E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))};
}

TetSprings couple_springs(const Matrix3Xd& X, const Matrix4Xi& T, const Lame& lame, const Blend& blend) {
  TetSprings springs;
  springs.mu = lame.mu;
  springs.first.push_back(0);
  const double shared = blend.nodes > 0 ? std::min(lame.lambda, lame.mu) : lame.lambda;
  if (blend.tetrahedra > 0) {
    const Eigen::MatrixXi own = Eigen::RowVectorXi::LinSpaced(T.cols(), 0, static_cast<int>(T.cols()) - 1);
    append_patches(X, T, own, blend.tetrahedra, shared, springs);
  }
  if (blend.edges > 0) append_patches(X, T, edge_numbers(T), blend.edges, shared, springs);
  if (blend.nodes > 0)
    append_patches(X, T, T, blend.nodes, shared + (lame.lambda - shared) / blend.nodes, springs);
  return springs;
}

double energy(const TetSprings& springs, const Matrix3Xd& x, const Eigen::VectorXd& scale) {
  double sum = 0;
  for (int p = 0; p < springs.n_patches(); ++p) {
    const double s = scale_of(scale, p);
    const Matrix3d F = deformation_gradient(springs, p, x) / s;
    sum += s * s * s * springs.volume[p] *
           (springs.mu / 2 * (F.squaredNorm() - 3) +
            volume_law(F.determinant(), springs.lambda[p], springs.mu).g);
  }
  return sum;
}

void add_forces(const TetSprings& springs, const Matrix3Xd& x, Matrix3Xd& f, const Eigen::VectorXd& scale) {
  for (int p = 0; p < springs.n_patches(); ++p) {
    const double s = scale_of(scale, p);
    const Matrix3d F = deformation_gradient(springs, p, x) / s, C = cofactor(F);
    const double J = F.col(0).dot(C.col(0));
    const Matrix3d VP =
        s * s * springs.volume[p] * (springs.mu * F + volume_law(J, springs.lambda[p], springs.mu).dg * C);
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
      f.col(springs.node[e]) -= VP * springs.b.col(e);
  }
}

TetStiffness stiffness_at(const TetSprings& springs, const Matrix3Xd& x) {
  TetStiffness result;
  result.H.reserve(springs.n_patches());
  for (int p = 0; p < springs.n_patches(); ++p)
    result.H.push_back(
        stiffness(deformation_gradient(springs, p, x), springs.lambda[p], springs.mu, Curvature::Projected));
  return result;
}

void add_product(const TetSprings& springs, const TetStiffness& stiffness, const Matrix3Xd& p, Matrix3Xd& y) {
  for (int patch = 0; patch < springs.n_patches(); ++patch) {
    const Matrix3d dF = deformation_gradient(springs, patch, p);
    Matrix3d VdP;
    Eigen::Map<Eigen::Matrix<double, 9, 1>>(VdP.data()) =
        springs.volume[patch] *
        (stiffness.H[patch] * Eigen::Map<const Eigen::Matrix<double, 9, 1>>(dF.data()));
    for (int e = springs.first[patch]; e < springs.first[patch + 1]; ++e)
      y.col(springs.node[e]) += VdP * springs.b.col(e);
  }
}

void add_hessian(const TetSprings& springs, const Matrix3Xd& x, BlockMatrix& K, Curvature curvature,
                 const Eigen::VectorXd& scale) {
  std::vector<Eigen::Matrix<double, 9, 3>> columns;
  for (int p = 0; p < springs.n_patches(); ++p) {
    const double s = scale_of(scale, p);
    const Matrix9d VH =
        s * springs.volume[p] *
        stiffness(deformation_gradient(springs, p, x) / s, springs.lambda[p], springs.mu, curvature);
    const int begin = springs.first[p], end = springs.first[p + 1];
    columns.clear();
    for (int e = begin; e < end; ++e) columns.push_back(VH * spread(springs.b.col(e)));
    for (int r = begin; r < end; ++r) {
      int k = K.row_start[springs.node[r]];  // a patch's nodes ascend, as do a row's columns
      for (int e = begin; e < end; ++e) {
        while (K.column[k] != springs.node[e]) ++k;
        for (int j = 0; j < 3; ++j) K.block[k] += springs.b(j, r) * columns[e - begin].middleRows<3>(3 * j);
      }
    }
  }
}

Eigen::Matrix2Xi pairs_of(const TetSprings& springs) {
  std::vector<std::pair<int, int>> pairs;
  for (int p = 0; p < springs.n_patches(); ++p)
    for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
      for (int r = springs.first[p]; r < e; ++r)
        pairs.emplace_back(std::minmax(springs.node[r], springs.node[e]));
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  Eigen::Matrix2Xi result(2, pairs.size());
  for (std::size_t k = 0; k < pairs.size(); ++k) result.col(k) << pairs[k].first, pairs[k].second;
  return result;
}

double smallest_jacobian(const TetSprings& springs, const Matrix3Xd& x) {
  double smallest = 1;
  for (int p = 0; p < springs.n_patches(); ++p)
    smallest = std::min(smallest, deformation_gradient(springs, p, x).determinant());
  return smallest;
}

double rest_volume(const Matrix3Xd& X, const Eigen::Vector4i& t) {
  const Vector3d a = X.col(t[0]);
  return (X.col(t[1]) - a).cross(X.col(t[2]) - a).dot(X.col(t[3]) - a) / 6;
}

Eigen::VectorXd lumped_mass(const Matrix3Xd& X, const Matrix4Xi& T, double rho) {
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(X.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t)
    for (int p : T.col(t)) mass[p] += rho / 4 * rest_volume(X, T.col(t));
  return mass;
}

}  // namespace testbed
