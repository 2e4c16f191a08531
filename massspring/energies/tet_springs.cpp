#include "massspring/energies/tet_springs.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "massspring/kernels/padded_nodes.h"
#include "massspring/kernels/patch_law.h"
#include "meshing/algebra/subdomains.h"
#include "meshing/base/geometry.h"

namespace testbed::massspring {

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Matrix4Xi;
using Eigen::Vector3d;

/// Smaller bodies fit the first-level cache in any order.
constexpr int kLeastOrdered = 500;

/// g(J) of the law.
double volume_energy(double J_1, double lambda, double mu) {
  const double c = mu + lambda / 2, j_1 = std::max(J_1, kLeastJacobian - 1), d = J_1 - j_1;
  const double dg = volume_slope(j_1, lambda, mu) - mu, ddg = volume_curvature(j_1, lambda, mu);
  return lambda / 4 * j_1 * (j_1 + 2) - c * std::log1p(j_1) + (dg + ddg / 2 * d) * d;
}

double scale_of(const Eigen::VectorXd& scale, int patch) {
  return scale.size() > 0 ? scale[patch] : 1;
}

std::size_t hash_of(const PatchBatches& batches) {
  const auto of = [](const std::vector<int>& list) {
    return std::hash<std::string_view>()(
        {reinterpret_cast<const char*>(list.data()), list.size() * sizeof(int)});
  };
  return of(batches.node) + 31 * of(batches.start);
}

/// Of the blocks that the pairs of entries of every batch add to.
std::vector<int> positions(const PatchBatches& batches, const BlockMatrix& K) {
  std::vector<int> result;
  result.reserve(kBatchSize * static_cast<std::size_t>(batches.pair_start.back()));
  for (int batch = 0; batch < batches.n_batches(); ++batch)
    for (int r = batches.start[batch]; r < batches.start[batch + 1]; ++r)
      for (int e = r; e < batches.start[batch + 1]; ++e)
        for (int lane = 0; lane < kBatchSize; ++lane) {
          const auto [i, j] =
              std::minmax(batches.node[kBatchSize * r + lane], batches.node[kBatchSize * e + lane]);
          result.push_back(K.find(i, j));
        }
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

/// Number of each of a tetrahedron's six edges among all edges, ordered by their ends, 6 x m.
Eigen::MatrixXi edge_numbers(const Matrix4Xi& T) {
  std::vector<int> lower, upper;  // ends
  for (const auto& t : T.colwise())
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) {
        lower.push_back(std::min(t[i], t[j]));
        upper.push_back(std::max(t[i], t[j]));
      }
  const int n = T.maxCoeff() + 1;
  const Occurrences edges = occurrences(lower, n);
  Eigen::MatrixXi numbers(6, T.cols());
  std::vector<int> met_from(n, -1), number_to(n), ends;
  int number = 0;
  for (int i = 0; i < n; ++i) {
    const auto for_each_edge = [&](const auto& visit) {
      for (int k = edges.first[i]; k < edges.first[i + 1]; ++k) visit(edges.at[k], upper[edges.at[k]]);
    };
    ends.clear();
    for_each_edge([&](int, int j) {
      if (std::exchange(met_from[j], i) != i) ends.push_back(j);
    });
    std::sort(ends.begin(), ends.end());
    for (const int j : ends) number_to[j] = number++;
    for_each_edge([&](int place, int j) { numbers(place) = number_to[j]; });
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
  for (Eigen::Index t = 0; t < T.cols(); ++t) {
    const Vector3d centre = X(Eigen::all, T.col(t)).rowwise().mean();
    for (const int p : patches.col(t)) centres.col(p) += centre;
  }
  const auto n_tets = [&](int p) { return in_patch.first[p + 1] - in_patch.first[p]; };
  for (int p = 0; p < n; ++p) centres.col(p) /= n_tets(p);
  std::vector<int> order = along_body(centres);
  for (int begin = 0; begin < n; begin += kWindow)
    std::stable_sort(order.begin() + begin, order.begin() + std::min(n, begin + kWindow),
                     [&](int p, int q) { return n_tets(p) < n_tets(q); });
  return order;
}

/// Patches that average over tetrahedra: column t of `patches` names those that tetrahedron t belongs to, which
/// share its volume evenly, and that of `part` how much of theirs they take. Their first Lame constant is lambda,
/// and `whole` more for all of the volume, whatever the part of it: then a patch takes one part of all its
/// tetrahedra, or uniform strain is out of balance.
struct Averages {
  Eigen::MatrixXi patches;
  Eigen::MatrixXd part;
  double lambda, whole;
  Occurrences in_patch = {};
  std::vector<int> order = {};

  /// Calls visit(t, part) for the tetrahedra of a patch.
  template <class Visit>
  void for_each_tet(int patch, const Visit& visit) const {
    for (int k = in_patch.first[patch]; k < in_patch.first[patch + 1]; ++k)
      visit(in_patch.at[k] / static_cast<int>(patches.rows()), part.data()[in_patch.at[k]]);
  }
};

/// Orders patches and appends the nodes of each.
void append_nodes(const Matrix3Xd& X, const Matrix4Xi& T, Averages& averages, TetSprings& springs) {
  const int n_before = static_cast<int>(springs.first.size()) - 1;
  averages.in_patch = occurrences(averages.patches.reshaped(), averages.patches.maxCoeff() + 1);
  std::vector<int>& order = averages.order;
  order = order_of_patches(X, T, averages.patches, averages.in_patch);
  if (X.cols() >= kLeastSubdivided) {
    const auto divided = patches_of_subdomains(X, T, averages.patches, order);
    order.clear();
    for (const std::vector<int>& own : divided) {
      springs.subdomain_first.push_back(n_before + static_cast<int>(order.size()));
      order.insert(order.end(), own.begin(), own.end());
    }
  }
  std::vector<int> patch_of(X.cols(), -1);  // of nodes: the last that they were met in
  for (const int p : order) {
    averages.for_each_tet(p, [&](int t, double) {
      for (int i : T.col(t))
        if (std::exchange(patch_of[i], p) != p) springs.node.push_back(i);
    });
    std::sort(springs.node.begin() + springs.first.back(), springs.node.end());
    springs.first.push_back(static_cast<int>(springs.node.size()));
  }
}

/// Lays patches that have their nodes out in batches, none of them of two subdomains, without their vectors.
void lay_out_batches(TetSprings& springs) {
  PatchBatches& batches = springs.batches;
  std::vector<int> first = springs.subdomain_first;  // of ranges
  if (first.empty()) first = {0, static_cast<int>(springs.first.size()) - 1};
  batches.first = batches.start = batches.pair_start = {0};
  for (std::size_t k = 0; k + 1 < first.size(); ++k) {
    if (!springs.subdomain_first.empty()) springs.subdomain_batch.push_back(batches.n_batches());
    for (int p = first[k]; p < first[k + 1]; p += kBatchSize) {
      const int n = std::min(kBatchSize, first[k + 1] - p);
      int n_entries = 0;
      for (int i = 0; i < n; ++i)
        n_entries = std::max(n_entries, springs.first[p + i + 1] - springs.first[p + i]);
      batches.first.push_back(p + n);
      batches.start.push_back(batches.start.back() + n_entries);
      batches.pair_start.push_back(batches.pair_start.back() + n_entries * (n_entries + 1) / 2);
    }
  }
  if (!springs.subdomain_first.empty()) springs.subdomain_batch.push_back(batches.n_batches());
  const std::size_t n_all = kBatchSize * static_cast<std::size_t>(batches.start.back());
  batches.node.resize(n_all);
  batches.b.resize(3 * n_all);
  for (int batch = 0; batch < batches.n_batches(); ++batch) {
    const int p = batches.first[batch], n = batches.first[batch + 1] - p;
    for (int i = 0; i < kBatchSize; ++i) {
      const int patch = p + std::min(i, n - 1), begin = springs.first[patch], end = springs.first[patch + 1];
      for (int at = batches.start[batch], e = begin; at < batches.start[batch + 1]; ++at, ++e)
        batches.node[kBatchSize * at + i] = springs.node[i < n && e < end ? e : begin];
    }
  }
}

PatchArrays arrays_of(const TetSprings& springs, const Eigen::VectorXd& scale) {
  return {springs.volume.data(), springs.lambda.data(), scale.size() > 0 ? scale.data() : nullptr,
          springs.mu};
}

/// Volumes, Lame's constants and vectors of patches that lie in batches, in the order of `all`.
void set_averages(const Matrix3Xd& X, const Matrix4Xi& T, const std::vector<Averages>& all,
                  TetSprings& springs) {
  std::vector<Eigen::Matrix4d> of_corners(T.cols());  // gradients of barycentric coordinates, and their means
  Eigen::VectorXd volume(T.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t) {
    volume[t] = tet_volume(X, T.col(t));
    of_corners[t] << barycentric_gradients(X, T.col(t)), Eigen::RowVector4d::Constant(0.25);
  }
  const auto n_patches = static_cast<Eigen::Index>(springs.first.size()) - 1;
  springs.volume.resize(n_patches);
  springs.lambda = Eigen::VectorXd::Zero(n_patches);
  springs.weight.resize(springs.first.back());
  PatchBatches& batches = springs.batches;
  std::vector<int> entry_of(X.cols());  // of nodes in the patch at hand
  Eigen::Matrix4Xd averaged;            // of its entries
  int p = 0, batch = 0;
  for (const Averages& averages : all)
    for (const int patch : averages.order) {
      const int begin = springs.first[p], n = springs.first[p + 1] - begin;
      for (int e = 0; e < n; ++e) entry_of[springs.node[begin + e]] = e;
      averaged.setZero(4, n);
      double own = 0, whole = 0;  // volumes
      averages.for_each_tet(patch, [&](int t, double part) {
        const double even = volume[t] / averages.patches.rows(), share = part * even;
        own += share;
        whole += even;
        for (int k = 0; k < 4; ++k) averaged.col(entry_of[T(k, t)]) += share * of_corners[t].col(k);
      });
      averaged /= own;
      springs.weight.segment(begin, n) = averaged.row(3);
      springs.volume[p] = own;
      if (own > 0)  // a node may belong to no tetrahedron
        springs.lambda[p] = averages.lambda + averages.whole * whole / own;
      if (p == batches.first[batch + 1]) ++batch;
      double* const x = &batches.b[3 * kBatchSize * static_cast<std::size_t>(batches.start[batch])];
      for (int e = 0; e < n; ++e)
        for (int j = 0; j < 3; ++j) x[kBatchSize * (3 * e + j) + p - batches.first[batch]] = averaged(j, e);
      ++p;
    }
}

/// Patches that average as they are told.
TetSprings couple(const Matrix3Xd& X, const Matrix4Xi& T, double mu, std::vector<Averages> all) {
  TetSprings springs;
  springs.mu = mu;
  springs.first.push_back(0);
  for (Averages& averages : all) append_nodes(X, T, averages, springs);
  springs.node.shrink_to_fit();
  if (!springs.subdomain_first.empty())
    springs.subdomain_first.push_back(static_cast<int>(springs.first.size()) - 1);
  lay_out_batches(springs);
  set_averages(X, T, all, springs);
  return springs;
}

/// A patch of each tetrahedron alone.
Averages alone(const Matrix4Xi& T, const Eigen::MatrixXd& parts, double lambda) {
  return {Eigen::RowVectorXi::LinSpaced(T.cols(), 0, static_cast<int>(T.cols()) - 1), parts, lambda, 0};
}

/// The nodes, and those that share a tetrahedron with them.
std::vector<char> near(const std::vector<int>& nodes, Eigen::Index n_nodes, const Matrix4Xi& T) {
  std::vector<char> is_constrained(n_nodes, 0);
  for (const int i : nodes) is_constrained[i] = 1;
  std::vector<char> is_near = is_constrained;
  for (const auto& corners : T.colwise())
    if (std::any_of(corners.begin(), corners.end(), [&](int i) { return is_constrained[i] != 0; }))
      for (const int i : corners) is_near[i] = 1;
  return is_near;
}

}  // namespace

Vector3d TetSprings::b(int p, int entry) const {
  const auto batch =
      std::upper_bound(batches.first.begin(), batches.first.end(), p) - batches.first.begin() - 1;
  const auto at = static_cast<std::size_t>(batches.start[batch]) + entry - first[p];
  const double* const x = &batches.b[3 * kBatchSize * at + p - batches.first[batch]];
  return {x[0], x[kBatchSize], x[2 * kBatchSize]};
}

Lame lame_of(const Material& material) {
  const double E = material.E, nu = material.nu;
  if (!(E > 0)) throw std::runtime_error("Young's modulus " + std::to_string(E) + " Pa, expected > 0");
  if (!(nu >= kLeastNu && nu <= kLargestNu))
    throw std::runtime_error("Poisson's ratio " + std::to_string(nu) + ", expected 0 to 0.499");
  return {E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))};
}

TetSprings couple_springs(const Matrix3Xd& X, const Matrix4Xi& T, const Lame& lame, const Blend& blend,
                          const std::vector<int>& constrained) {
  const double shared = blend.nodes > 0 ? std::min(lame.lambda, lame.mu) : lame.lambda;
  const auto everywhere = [&](int n_sharers, double part) {
    return Eigen::MatrixXd::Constant(n_sharers, T.cols(), part).eval();
  };
  Eigen::MatrixXd edges = everywhere(6, blend.edges), nodes = everywhere(4, blend.nodes);
  if (blend.nodes > 0) {
    const std::vector<char> is_near = near(constrained, X.cols(), T);
    for (Eigen::Index t = 0; t < T.cols(); ++t) {
      for (int k = 0; k < 4; ++k)
        if (is_near[T(k, t)]) nodes(k, t) = kConstrainedNodes;
      edges.col(t).setConstant(1 - blend.tetrahedra - nodes.col(t).mean());
    }
  }
  std::vector<Averages> all;
  if (blend.tetrahedra > 0) all.push_back(alone(T, everywhere(1, blend.tetrahedra), shared));
  if (blend.edges > 0) all.push_back({edge_numbers(T), std::move(edges), shared, 0});
  if (blend.nodes > 0) all.push_back({T, std::move(nodes), shared, lame.lambda - shared});
  return couple(X, T, lame.mu, std::move(all));
}

Eigen::RowVectorXd parts_left_by_averages(const Matrix3Xd& X, const Matrix4Xi& T) {
  constexpr double kAroundEdge = 5;  // tetrahedra, in the mean
  const Eigen::MatrixXi edges = edge_numbers(T);
  Eigen::VectorXd around = Eigen::VectorXd::Zero(edges.maxCoeff() + 1);
  Eigen::RowVectorXd parts(T.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t) {
    parts[t] = tet_volume(X, T.col(t));
    for (const int e : edges.col(t)) around[e] += parts[t];
  }
  for (Eigen::Index t = 0; t < T.cols(); ++t)
    parts[t] = std::min(1., kAroundEdge * parts[t] * around(edges.col(t)).cwiseInverse().mean());
  return parts;
}

TetSprings single_tetrahedra(const Matrix3Xd& X, const Matrix4Xi& T, const Lame& lame,
                             const Eigen::RowVectorXd& parts) {
  return couple(X, T, lame.mu, {alone(T, parts, lame.lambda)});
}

BlockMatrix stiffness_of_tetrahedra(const Matrix3Xd& X, const Matrix4Xi& T, const Lame& lame,
                                    const Eigen::RowVectorXd& parts) {
  std::vector<Eigen::Matrix<double, 3, 4>> gradients(T.cols());
  Eigen::VectorXd volume(T.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t) {
    gradients[t] = barycentric_gradients(X, T.col(t));
    volume[t] = parts[t] * tet_volume(X, T.col(t));
  }
  const auto n = static_cast<int>(X.cols());
  const Occurrences of_node = occurrences(T.reshaped(), n);
  BlockMatrix K;
  K.row_start.push_back(0);
  std::vector<int> at(n, -1);  // of each node its block in the row at hand
  for (int i = 0; i < n; ++i) {
    const int begin = K.row_start.back();
    const auto add = [&](int j) {
      if (at[j] < begin) K.column.push_back(j);
      at[j] = begin;
    };
    add(i);  // a node may belong to no tetrahedron
    for (int k = of_node.first[i]; k < of_node.first[i + 1]; ++k)
      for (const int j : T.col(of_node.at[k] / 4)) add(j);
    std::sort(K.column.begin() + begin, K.column.end());
    const auto end = static_cast<int>(K.column.size());
    K.block.resize(end, Matrix3d::Zero());
    for (int k = begin; k < end; ++k) at[K.column[k]] = k;
    K.diagonal.push_back(at[i]);
    K.row_start.push_back(end);
    for (int k = of_node.first[i]; k < of_node.first[i + 1]; ++k) {
      const int t = of_node.at[k] / 4;
      const Vector3d b = gradients[t].col(of_node.at[k] % 4);
      for (int c = 0; c < 4; ++c) {
        const Vector3d d = gradients[t].col(c);
        Matrix3d& block = K.block[at[T(c, t)]];
        block.noalias() += volume[t] * lame.lambda * b * d.transpose();
        block.noalias() += volume[t] * lame.mu * d * b.transpose();
        block.diagonal().array() += volume[t] * lame.mu * b.dot(d);
      }
    }
  }
  return K;
}

double energy(const TetSprings& springs, const Matrix3Xd& u, const Eigen::VectorXd& scale) {
  const PatchBatches& batches = springs.batches;
  const Double4* const columns = pad(u);
  return sum_over_chunks(batches.n_batches(), [&](Eigen::Index begin, Eigen::Index end) {
    double J_1[kBatchSize * kChunkSize], squares_3[kBatchSize * kChunkSize], sum = 0;
    measure_patches(static_cast<int>(begin), static_cast<int>(end), batches, arrays_of(springs, scale),
                    columns, J_1, squares_3);
    for (int p = batches.first[begin], i = 0; p < batches.first[end]; ++p, ++i) {
      const double s = scale_of(scale, p);
      sum += s * s * s * springs.volume[p] *
             (springs.mu / 2 * squares_3[i] + volume_energy(J_1[i], springs.lambda[p], springs.mu));
    }
    return sum;
  });
}

void add_forces(const TetSprings& springs, const Matrix3Xd& u, Matrix3Xd& f, const Eigen::VectorXd& scale) {
  const PatchBatches& batches = springs.batches;
  add_padded(
      [&](const Double4* in, Double4* out) {
        for_each_range(springs.subdomain_batch, batches.n_batches(), [&](int begin, int end) {
          add_patch_forces(begin, end, batches, arrays_of(springs, scale), in, out);
        });
      },
      u, f);
}

void add_linear_forces(const TetSprings& springs, const Matrix3Xd& u, Matrix3Xd& f) {
  const PatchBatches& batches = springs.batches;
  add_padded(
      [&](const Double4* in, Double4* out) {
        for_each_range(springs.subdomain_batch, batches.n_batches(), [&](int begin, int end) {
          add_linear_patch_forces(begin, end, batches, arrays_of(springs, {}), in, out);
        });
      },
      u, f);
}

namespace {

/// Calls visit(p, i, b) for each patch p and node i of it.
template <class Visit>
void for_each_entry(const PatchBatches& batches, const Visit& visit) {
  for (int batch = 0; batch < batches.n_batches(); ++batch)
    for (int p = batches.first[batch]; p < batches.first[batch + 1]; ++p)
      for (int e = batches.start[batch]; e < batches.start[batch + 1]; ++e) {
        const int lane = p - batches.first[batch];
        const double* const x = &batches.b[3 * kBatchSize * static_cast<std::size_t>(e) + lane];
        visit(p, batches.node[kBatchSize * e + lane], Vector3d(x[0], x[kBatchSize], x[2 * kBatchSize]));
      }
}

}  // namespace

void add_diagonal(const TetSprings& springs, double factor, std::vector<Matrix3d>& blocks) {
  for_each_entry(springs.batches, [&](int p, int i, const Vector3d& b) {
    blocks[i] += factor * springs.volume[p] *
                 ((springs.lambda[p] + springs.mu) * b * b.transpose() +
                  springs.mu * b.squaredNorm() * Matrix3d::Identity());
  });
}

void add_row_sums(const TetSprings& springs, Eigen::VectorXd& sums) {
  Eigen::VectorXd lengths = Eigen::VectorXd::Zero(springs.n_patches());
  for_each_entry(springs.batches, [&](int p, int, const Vector3d& b) { lengths[p] += b.norm(); });
  for_each_entry(springs.batches, [&](int p, int i, const Vector3d& b) {
    sums[i] += springs.volume[p] * (springs.lambda[p] + 2 * springs.mu) * b.norm() * lengths[p];
  });
}

SinglePatches single_precision(const TetSprings& springs) {
  return single_precision(springs.batches, arrays_of(springs, {}));
}

void add_product(const TetSprings& springs, const SinglePatches& single, const PaddedField& p,
                 PaddedField& y) {
  for_each_range(springs.subdomain_batch, springs.batches.n_batches(), [&](int begin, int end) {
    add_patch_products(begin, end, springs.batches, single, p.data(), y.data());
  });
}

void add_hessian(const TetSprings& springs, const Matrix3Xd& u, BlockMatrix& K, Curvature curvature,
                 const Eigen::VectorXd& scale) {
  const PatchBatches& batches = springs.batches;
  if (const std::size_t hash = hash_of(batches); K.kept_of != hash) {
    K.kept = positions(batches, K);
    K.kept_of = hash;
  }
  const Double4* const columns = pad(u);
  for_each_range(springs.subdomain_batch, batches.n_batches(), [&](int begin, int end) {
    add_patch_hessians(begin, end, batches, arrays_of(springs, scale), columns, curvature, K.kept.data(),
                       K.block.data());
  });
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

double smallest_jacobian(const TetSprings& springs, const Matrix3Xd& u) {
  std::vector<double> J_1(springs.n_patches()), squares_3(J_1.size());
  measure_patches(0, springs.batches.n_batches(), springs.batches, arrays_of(springs, {}), pad(u), J_1.data(),
                  squares_3.data());
  return 1 + *std::min_element(J_1.begin(), J_1.end());
}

Eigen::VectorXd lumped_mass(const Matrix3Xd& X, const Matrix4Xi& T, double rho) {
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(X.cols());
  for (Eigen::Index t = 0; t < T.cols(); ++t)
    for (int p : T.col(t)) mass[p] += rho / 4 * tet_volume(X, T.col(t));
  return mass;
}

}  // namespace testbed::massspring
