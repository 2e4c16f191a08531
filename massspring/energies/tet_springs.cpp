#include "massspring/energies/tet_springs.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/Jacobi>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "massspring/kernels/padded_nodes.h"
#include "massspring/kernels/patch_law.h"
#include "meshing/algebra/rigid_motion.h"
#include "meshing/algebra/subdomains.h"
#include "meshing/base/geometry.h"

namespace testbed::massspring {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Matrix4Xi;
using Eigen::Vector3d;
using TetGradients = Eigen::Matrix<double, 3, 4>;

/// Smaller bodies fit the first-level cache in any order.
constexpr int kLeastOrdered = 500;

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
  const double c = mu + lambda / 2, j = std::max(J, kLeastJacobian), d = J - j;
  const double dg = lambda / 2 * j - c / j, ddg = lambda / 2 + c / (j * j);
  return {lambda / 4 * (j * j - 1) - c * std::log(j) + (dg + ddg / 2 * d) * d, volume_slope(J, lambda, mu),
          ddg};
}

Matrix3d deformation_gradient(const TetSprings& springs, int patch, const Matrix3Xd& x) {
  double F[9] = {};  // as far as a compiler sees, a matrix might alias x
  for (int e = springs.first[patch]; e < springs.first[patch + 1]; ++e)
    for (int j = 0; j < 3; ++j)
      for (int i = 0; i < 3; ++i) F[3 * j + i] += x(i, springs.node[e]) * springs.b(j, e);
  return Eigen::Map<Matrix3d>(F);
}

double scale_of(const Eigen::VectorXd& scale, int patch) {
  return scale.size() > 0 ? scale[patch] : 1;
}

Matrix3d cofactor(const Matrix3d& F) {
  Matrix3d C;
  C << F.col(1).cross(F.col(2)), F.col(2).cross(F.col(0)), F.col(0).cross(F.col(1));
  return C;
}

/// F = U diag(s) V^T with rotations U and V, so that at most one s is negative.
struct SingularValues {
  Matrix3d U, V;
  Vector3d s;
};

/// Columns are rotated against each other until they are orthogonal [Hestenes 1958], which is exact to
/// rounding however small one is beside the others.
SingularValues singular_values(const Matrix3d& F) {
  constexpr double kOrthogonal = 1e-14;
  constexpr int kMaxSweeps = 20;
  Matrix3d A = F, V = Matrix3d::Identity();
  bool is_orthogonal = false;
  for (int sweep = 0; sweep < kMaxSweeps && !is_orthogonal; ++sweep) {
    is_orthogonal = true;
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      const double ij = A.col(i).dot(A.col(j)), ii = A.col(i).squaredNorm(), jj = A.col(j).squaredNorm();
      if (!(std::abs(ij) > kOrthogonal * std::sqrt(ii * jj))) continue;
      is_orthogonal = false;
      Eigen::JacobiRotation<double> rotation;
      rotation.makeJacobi(ii, ij, jj);
      A.applyOnTheRight(i, j, rotation);
      V.applyOnTheRight(i, j, rotation);
    }
  }
  Vector3d s = A.colwise().norm();
  int k;
  s.minCoeff(&k);
  const int i = (k + 1) % 3, j = (k + 2) % 3;
  Matrix3d U;
  U.col(i) = s[i] > 0 ? Vector3d(A.col(i) / s[i]) : A.col(j).unitOrthogonal();
  U.col(j) = s[j] > 0 ? Vector3d(A.col(j) / s[j]) : U.col(i).unitOrthogonal();
  U.col(k) = U.col(i).cross(U.col(j));
  s[k] = U.col(k).dot(A.col(k));
  return {U, V, s};
}

/// Parts k (E : dF)^2 of psi'': that of g'' and at most
/// five negative eigenvalues' [Smith, de Goes & Kim 2019].
struct Modes {
  int n = 0;
  std::array<double, 6> k;
  std::array<Matrix3d, 6> E;

  void add(double stiffness, const Matrix3d& direction) {
    k[n] = stiffness;
    E[n++] = direction;
  }
};

/// Adds what lifts the negative eigenvalues of psi'' to 0. In the basis u_i v_j^T of F's singular vectors
/// psi'' has a 3 x 3 block of stretches, and for each pair of axes i, j a twist and a flip with eigenvalues
/// mu +- g' s_k.
void add_projection(const Matrix3d& F, const VolumeLaw& law, double mu, Modes& modes) {
  const auto [U, V, s] = singular_values(F);
  const Vector3d c(s[1] * s[2], s[2] * s[0], s[0] * s[1]);
  Matrix3d stretch = mu * Matrix3d::Identity() + law.ddg * c * c.transpose();
  for (int k = 0; k < 3; ++k) {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    const double turning = law.dg * s[k];
    stretch(i, j) += turning;
    stretch(j, i) += turning;
    const double least = mu - std::abs(turning);
    if (least < 0)
      modes.add(-least / 2, U.col(i) * V.col(j).transpose() +
                                std::copysign(1, turning) * U.col(j) * V.col(i).transpose());
  }
  if (stretch.llt().info() == Eigen::Success) return;
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(stretch);
  for (int k = 0; k < 3; ++k)
    if (eigen.eigenvalues()[k] < 0)
      modes.add(-eigen.eigenvalues()[k], U * eigen.eigenvectors().col(k).asDiagonal() * V.transpose());
}

/// psi'' = mu |dF|^2 + g'' (C : dF)^2 + g' d2J, of which block (a, b) of d2J takes v to -F_c x v when a, b, c
/// follow each other.
Stiffness stiffness(const Matrix3d& F, double lambda, double mu, Curvature curvature) {
  const Matrix3d C = cofactor(F);
  const VolumeLaw law = volume_law(F.col(0).dot(C.col(0)), lambda, mu);
  Modes modes;
  modes.add(law.ddg, C);
  if (curvature == Curvature::Projected) add_projection(F, law, mu, modes);
  Stiffness H;
  const auto block = [&H](int a, int b) { return Eigen::Map<Matrix3d>(H.col(a).data() + 9 * b); };
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    block(a, a) = mu * Matrix3d::Identity();
    block(a, b) = -law.dg * cross_product_matrix(F.col(c));
    block(b, a) = -block(a, b);
  }
  for (int m = 0; m < modes.n; ++m)
    for (int a = 0; a < 3; ++a) {
      const Vector3d kE = modes.k[m] * modes.E[m].col(a);
      for (int b = 0; b < 3; ++b) block(a, b) += kE * modes.E[m].col(b).transpose();
    }
  return H;
}

/// Of blocks (r, e), r <= e, of every patch.
std::vector<int> positions(const TetSprings& springs, const BlockMatrix& K) {
  std::vector<int> result;
  for (int p = 0; p < springs.n_patches(); ++p)
    for (int r = springs.first[p]; r < springs.first[p + 1]; ++r)
      for (int e = r; e < springs.first[p + 1]; ++e)
        result.push_back(K.find(springs.node[r], springs.node[e]));
  return result;
}

/// Where each of 0 ... n - 1 occurs in a list: v at the places at[first[v]] ... at[first[v + 1] - 1],
/// ascending.
struct Occurrences {
  std::vector<int> first, at;
};

template <class List>
Occurrences occurrences(const List& list, int n) {
  Occurrences result{std::vector<int>(n + 1, 0), std::vector<int>(list.size())};
  for (int v : list) ++result.first[v + 1];
  std::partial_sum(result.first.begin(), result.first.end(), result.first.begin());
  std::vector<int> next(result.first.begin(), result.first.end() - 1);
  int place = 0;
  for (int v : list) result.at[next[v]++] = place++;
  return result;
}

/// Number of each of a tetrahedron's six edges among all edges, 6 x m.
Eigen::MatrixXi edge_numbers(const Matrix4Xi& T) {
  std::vector<std::array<int, 3>> edges;  // its ends, its place in the result
  for (const auto& t : T.colwise())
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j)
        edges.push_back({std::min(t[i], t[j]), std::max(t[i], t[j]), static_cast<int>(edges.size())});
  std::sort(edges.begin(), edges.end());
  Eigen::MatrixXi numbers(6, T.cols());
  int number = 0;
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (k > 0 && (edges[k][0] != edges[k - 1][0] || edges[k][1] != edges[k - 1][1])) ++number;
    numbers(edges[k][2]) = number;
  }
  return numbers;
}

/// Calls visit(begin, end) for the ranges of n patches, or batches, that begin where `first` says, those of
/// subdomains of one size at once.
template <class Visit>
void for_each_range(const std::vector<int>& first, int n, const Visit& visit) {
  if (first.empty()) return visit(0, n);
  for_each_subdomain([&](int subdomain) {
    for (std::size_t k = subdomain; k + 1 < first.size(); k += kSubdomains) visit(first[k], first[k + 1]);
  });
}

/// Patches in a given order, divided into those of each subdomain; column t of `patches` names those that
/// tetrahedron t belongs to.
std::vector<std::vector<int>> patches_of_subdomains(const Matrix3Xd& X, const Matrix4Xi& T,
                                                    const Eigen::MatrixXi& patches,
                                                    const std::vector<int>& order) {
  const std::vector<int> leaf = leaves_of(X);
  Eigen::Matrix2Xi range = Eigen::Vector2i(7, 0).replicate(1, patches.maxCoeff() + 1);
  for (Eigen::Index t = 0; t < T.cols(); ++t)
    for (int p : patches.col(t))
      for (int i : T.col(t)) {
        range(0, p) = std::min(range(0, p), leaf[i]);
        range(1, p) = std::max(range(1, p), leaf[i]);
      }
  std::vector<std::vector<int>> result(kSubdomains);
  for (const int p : order) result[subdomain_of(range(0, p), range(1, p))].push_back(p);
  return result;
}

/// Patches along the body, those of like numbers of tetrahedra near each other.
std::vector<int> order_of_patches(const Matrix3Xd& X, const Matrix4Xi& T, const Eigen::MatrixXi& patches,
                                  const Occurrences& in_patch) {
  constexpr int kWindow = 32 * kBatchSize;  // of patches that are sorted by their numbers of tetrahedra
  const int n = patches.maxCoeff() + 1;
  if (X.cols() < kLeastOrdered) {
    std::vector<int> order(n);
    std::iota(order.begin(), order.end(), 0);
    return order;
  }
  Matrix3Xd centres = Matrix3Xd::Zero(3, n);
  for (Eigen::Index t = 0; t < T.cols(); ++t)
    for (const int p : patches.col(t)) centres.col(p) += X(Eigen::all, T.col(t)).rowwise().mean();
  const auto n_tets = [&](int p) { return in_patch.first[p + 1] - in_patch.first[p]; };
  for (int p = 0; p < n; ++p) centres.col(p) /= n_tets(p);
  std::vector<int> order = along_body(centres);
  for (int begin = 0; begin < n; begin += kWindow)
    std::stable_sort(order.begin() + begin, order.begin() + std::min(n, begin + kWindow),
                     [&](int p, int q) { return n_tets(p) < n_tets(q); });
  return order;
}

/// Lays the patches out in batches, none of them of two subdomains.
void fill_batches(TetSprings& springs) {
  PatchBatches& batches = springs.batches;
  std::vector<int> first = springs.subdomain_first;  // of ranges
  if (first.empty()) first = {0, springs.n_patches()};
  batches.first = batches.start = {0};
  for (std::size_t k = 0; k + 1 < first.size(); ++k) {
    if (!springs.subdomain_first.empty()) springs.subdomain_batch.push_back(batches.n_batches());
    for (int p = first[k]; p < first[k + 1]; p += kBatchSize) {
      const int n = std::min(kBatchSize, first[k + 1] - p), n_before = batches.start.back();
      int n_entries = 0;
      for (int i = 0; i < n; ++i)
        n_entries = std::max(n_entries, springs.first[p + i + 1] - springs.first[p + i]);
      batches.first.push_back(p + n);
      batches.start.push_back(n_before + n_entries);
      batches.node.resize(kBatchSize * batches.start.back());
      batches.b.resize(3 * kBatchSize * static_cast<std::size_t>(batches.start.back()));
      for (int i = 0; i < kBatchSize; ++i) {
        const int patch = p + std::min(i, n - 1), begin = springs.first[patch],
                  end = springs.first[patch + 1];
        for (int e = 0; e < n_entries; ++e) {
          const bool is_there = i < n && begin + e < end;
          const auto at = static_cast<std::size_t>(n_before) + e;
          batches.node[kBatchSize * at + i] = springs.node[is_there ? begin + e : begin];
          for (int j = 0; j < 3; ++j)
            batches.b[kBatchSize * (3 * at + j) + i] = is_there ? springs.b(j, begin + e) : 0;
        }
      }
    }
  }
  if (!springs.subdomain_first.empty()) springs.subdomain_batch.push_back(batches.n_batches());
}

PatchArrays arrays_of(const TetSprings& springs, const Eigen::VectorXd& scale) {
  return {springs.volume.data(), springs.lambda.data(), scale.size() > 0 ? scale.data() : nullptr,
          springs.mu};
}

/// Adds patches that average over tetrahedra: column t of `patches` names those that tetrahedron t belongs
/// to, each with an equal share of `share_of_all` of its volume.
void append_patches(const Matrix3Xd& X, const Matrix4Xi& T, const Eigen::MatrixXi& patches,
                    double share_of_all, double lambda, TetSprings& springs) {
  std::vector<TetGradients> shares(T.cols());  // of volume times gradients
  Eigen::VectorXd share(T.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t) {
    share[t] = share_of_all * tet_volume(X, T.col(t)) / static_cast<double>(patches.rows());
    shares[t] = share[t] * barycentric_gradients(X, T.col(t));
  }
  const int n_before = springs.n_patches(), n_new = patches.maxCoeff() + 1;
  const auto resize = [&](Eigen::Index n) {
    springs.b.conservativeResize(3, n);
    springs.weight.conservativeResize(n);
  };
  const auto n_entries = static_cast<Eigen::Index>(springs.node.size()), n_most = 4 * patches.size();
  resize(n_entries + n_most);
  springs.b.rightCols(n_most).setZero();
  springs.weight.tail(n_most).setZero();
  springs.volume.conservativeResize(n_before + n_new);
  springs.lambda.conservativeResize(n_before + n_new);
  springs.lambda.tail(n_new).setConstant(lambda);

  const Occurrences in_patch = occurrences(patches.reshaped(), n_new);
  std::vector<int> order = order_of_patches(X, T, patches, in_patch);
  if (X.cols() >= kLeastSubdivided) {
    const auto divided = patches_of_subdomains(X, T, patches, order);
    order.clear();
    for (const std::vector<int>& own : divided) {
      springs.subdomain_first.push_back(n_before + static_cast<int>(order.size()));
      order.insert(order.end(), own.begin(), own.end());
    }
  }
  std::vector<int> patch_of(X.cols(), -1), entry_of(X.cols());  // of nodes: the last that they were met in
  for (const int p : order) {
    const auto tets = [&](const auto& visit) {
      for (int k = in_patch.first[p]; k < in_patch.first[p + 1]; ++k)
        visit(in_patch.at[k] / static_cast<int>(patches.rows()));
    };
    const int begin = springs.first.back();
    tets([&](int t) {
      for (int i : T.col(t))
        if (std::exchange(patch_of[i], p) != p) springs.node.push_back(i);
    });
    const int end = static_cast<int>(springs.node.size());
    std::sort(springs.node.begin() + begin, springs.node.end());
    for (int e = begin; e < end; ++e) entry_of[springs.node[e]] = e;
    double volume = 0;
    tets([&](int t) {
      volume += share[t];
      for (int k = 0; k < 4; ++k) {
        springs.b.col(entry_of[T(k, t)]) += shares[t].col(k);
        springs.weight[entry_of[T(k, t)]] += share[t] / 4;
      }
    });
    springs.b.middleCols(begin, end - begin) /= volume;
    springs.weight.segment(begin, end - begin) /= volume;
    springs.volume[springs.first.size() - 1] = volume;
    springs.first.push_back(end);
  }
  resize(springs.first.back());
}

}  // namespace

Lame lame_of(const Material& material) {
  const double E = material.E, nu = material.nu;
  if (!(E > 0)) throw std::runtime_error("Young's modulus " + std::to_string(E) + " Pa, expected > 0");
  if (!(nu >= kLeastNu && nu <= kLargestNu))
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
  if (!springs.subdomain_first.empty()) springs.subdomain_first.push_back(springs.n_patches());
  fill_batches(springs);
  return springs;
}

double energy(const TetSprings& springs, const Matrix3Xd& x, const Eigen::VectorXd& scale) {
  const PatchBatches& batches = springs.batches;
  const Double4* const columns = pad(x);
  return sum_over_chunks(batches.n_batches(), [&](Eigen::Index begin, Eigen::Index end) {
    double J[kBatchSize * kChunkSize], squares[kBatchSize * kChunkSize], sum = 0;
    measure_patches(static_cast<int>(begin), static_cast<int>(end), batches, arrays_of(springs, scale),
                    columns, J, squares);
    for (int p = batches.first[begin], i = 0; p < batches.first[end]; ++p, ++i) {
      const double s = scale_of(scale, p);
      sum += s * s * s * springs.volume[p] *
             (springs.mu / 2 * (squares[i] - 3) + volume_law(J[i], springs.lambda[p], springs.mu).g);
    }
    return sum;
  });
}

void add_forces(const TetSprings& springs, const Matrix3Xd& x, Matrix3Xd& f, const Eigen::VectorXd& scale) {
  const PatchBatches& batches = springs.batches;
  add_padded(
      [&](const Double4* in, Double4* out) {
        for_each_range(springs.subdomain_batch, batches.n_batches(), [&](int begin, int end) {
          add_patch_forces(begin, end, batches, arrays_of(springs, scale), in, out);
        });
      },
      x, f);
}

void add_hessian(const TetSprings& springs, const Matrix3Xd& x, BlockMatrix& K, Curvature curvature,
                 const Eigen::VectorXd& scale) {
  if (K.coupled.empty()) K.coupled = positions(springs, K);
  std::vector<int> n_before{0};  // positions of the patches before each
  for (int p = 0; p < springs.n_patches(); ++p) {
    const int n = springs.first[p + 1] - springs.first[p];
    n_before.push_back(n_before.back() + n * (n + 1) / 2);
  }
  for_each_range(springs.subdomain_first, springs.n_patches(), [&](int begin, int end) {
    for (int p = begin; p < end; ++p) {
      const double s = scale_of(scale, p);
      const Matrix3d F = deformation_gradient(springs, p, x) / s;
      const int first = springs.first[p], n = springs.first[p + 1] - first;
      add_patch_blocks(stiffness(F, springs.lambda[p], springs.mu, curvature), s * springs.volume[p],
                       springs.b.col(first).data(), n, K.coupled.data() + n_before[p], K.block.data());
    }
  });
  mirror(K);
}

Eigen::Matrix2Xi pairs_of(const TetSprings& springs) {
  const int n = springs.node.empty() ? 0 : 1 + *std::max_element(springs.node.begin(), springs.node.end());
  const Occurrences of_node = occurrences(springs.node, n);
  std::vector<int> end;  // of each entry's patch
  for (int p = 0; p < springs.n_patches(); ++p) end.resize(springs.first[p + 1], springs.first[p + 1]);
  std::vector<int> partner_of(n, -1), partners, pairs;
  for (int i = 0; i < n; ++i) {
    partners.clear();
    for (int k = of_node.first[i]; k < of_node.first[i + 1]; ++k)
      for (int e = of_node.at[k] + 1; e < end[of_node.at[k]]; ++e)
        if (std::exchange(partner_of[springs.node[e]], i) != i) partners.push_back(springs.node[e]);
    std::sort(partners.begin(), partners.end());
    for (int j : partners) pairs.insert(pairs.end(), {i, j});
  }
  return Eigen::Map<Eigen::Matrix2Xi>(pairs.data(), 2, static_cast<Eigen::Index>(pairs.size() / 2));
}

double smallest_jacobian(const TetSprings& springs, const Matrix3Xd& x) {
  double smallest = std::numeric_limits<double>::infinity();
  for (int p = 0; p < springs.n_patches(); ++p)
    smallest = std::min(smallest, deformation_gradient(springs, p, x).determinant());
  return smallest;
}

Eigen::VectorXd lumped_mass(const Matrix3Xd& X, const Matrix4Xi& T, double rho) {
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(X.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t)
    for (int p : T.col(t)) mass[p] += rho / 4 * tet_volume(X, T.col(t));
  return mass;
}

}  // namespace testbed::massspring
