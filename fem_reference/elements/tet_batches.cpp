#include "fem_reference/elements/tet_batches.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "meshing/algebra/subdomains.h"
#include "meshing/algebra/vectors.h"

namespace testbed::fem {

using Eigen::Matrix3Xd;

namespace {

constexpr int kLanes = 8;
constexpr int kGeometry = 10 * kLanes;  // numbers of a batch
constexpr int kMaxNodes = 10;
constexpr int kPointsAtOnce = 4;  // whose shape functions a stiffness keeps at hand

/// Local node between two corners, in VTK's order.
constexpr int kBetween[4][4] = {{0, 4, 6, 7}, {4, 1, 5, 8}, {6, 5, 2, 9}, {7, 8, 9, 3}};

template <class Real>
struct Lanes;
template <>
struct Lanes<double> {
  using Vector = meshing::AlignedDouble8;
  using Real = double;
};
template <>
struct Lanes<float> {
  using Vector = meshing::AlignedFloat8;
  using Real = float;
};

// Of numbers that may lie anywhere.
[[gnu::always_inline]] inline meshing::Double8& vector(double* eight) {
  return *reinterpret_cast<meshing::Double8*>(eight);
}
[[gnu::always_inline]] inline meshing::Float8& vector(float* eight) {
  return *reinterpret_cast<meshing::Float8*>(eight);
}

}  // namespace

/// What loops over batches read, as pointers.
struct TetBatches::View {
  ElasticLaw law;
  int n;  ///< nodes of a tetrahedron
  int n_points;
  double lambda, mu, kappa;
  const int *node, *n_lanes, *n_counted, *place;
  const double *geometry, *shrinkage, *points, *weights;  ///< shrinkage: null where there is none
};

namespace {

using View = TetBatches::View;

/// A batch: gradients of barycentric coordinates 1 to 3, volumes, and displacements of nodes less those of
/// the first, from which a small strain keeps its digits in single precision.
template <class Real>
struct Batch {
  using V = typename Lanes<Real>::Vector;

  const View& view;
  const int* node;
  const double* shrinkage;
  alignas(64) Real geometry[kGeometry];
  alignas(64) Real u[kMaxNodes][3][kLanes];

  [[gnu::always_inline]] Batch(const View& view, int b, const double* displacement) : view(view) {
    node = view.node + static_cast<std::ptrdiff_t>(b) * view.n * kLanes;
    shrinkage =
        view.shrinkage ? view.shrinkage + static_cast<std::ptrdiff_t>(b) * view.n_points * kLanes : nullptr;
    const double* from = view.geometry + static_cast<std::ptrdiff_t>(b) * kGeometry;
    for (int k = 0; k < kGeometry; ++k) geometry[k] = static_cast<Real>(from[k]);
    for (int lane = 0; lane < kLanes; ++lane) {
      const double* first = displacement + 3 * static_cast<std::ptrdiff_t>(node[lane]);
      for (int a = 0; a < view.n; ++a) {
        const double* at = displacement + 3 * static_cast<std::ptrdiff_t>(node[a * kLanes + lane]);
        for (int c = 0; c < 3; ++c) u[a][c][lane] = static_cast<Real>(at[c] - first[c]);
      }
    }
  }

  [[gnu::always_inline]] const V& volume() const { return vector(geometry + 9 * kLanes); }
  /// Component k of the gradient of barycentric coordinate i = 1 to 3.
  [[gnu::always_inline]] const V& g(int i, int k) const {
    return vector(geometry + (3 * (i - 1) + k) * kLanes);
  }
  [[gnu::always_inline]] static const V& vector(const Real* eight) {
    return *reinterpret_cast<const V*>(eight);
  }

  [[gnu::always_inline]] V shrinkage_at(int q) const {
    V s{};
    if (shrinkage)
      for (int lane = 0; lane < kLanes; ++lane) s[lane] = static_cast<Real>(shrinkage[q * kLanes + lane]);
    return s;
  }

  /// Gradient of the displacement at a point.
  [[gnu::always_inline]] void gradient(int q, V (*H)[3]) const {
    const double* l = view.points + 4 * q;
    V D[4][3];  // derivatives by the barycentric coordinates
    for (int i = 0; i < 4; ++i)
      for (int c = 0; c < 3; ++c) {
        D[i][c] = vector(u[i][c]);
        if (view.n == 4) continue;
        D[i][c] = static_cast<Real>(4 * l[i] - 1) * D[i][c];
        for (int j = 0; j < 4; ++j)
          if (j != i) D[i][c] += static_cast<Real>(4 * l[j]) * vector(u[kBetween[i][j]][c]);
      }
    for (int c = 0; c < 3; ++c)
      for (int k = 0; k < 3; ++k)
        H[c][k] =
            (D[1][c] - D[0][c]) * g(1, k) + (D[2][c] - D[0][c]) * g(2, k) + (D[3][c] - D[0][c]) * g(3, k);
  }

  [[gnu::always_inline]] V weight(int q) const { return static_cast<Real>(view.weights[q]) * volume(); }
};

template <ElasticLaw law>
struct Energy {
  [[gnu::always_inline]] static void add(const View& view, int b, const double* u, double& total) {
    using V = meshing::AlignedDouble8;
    const Batch<double> batch(view, b, u);
    V sum{};
    for (int q = 0; q < view.n_points; ++q) {
      V H[3][3];
      batch.gradient(q, H);
      const LawAt<law, Lanes<double>> at(H, batch.shrinkage_at(q), view.lambda, view.mu, view.kappa);
      V W = at.energy_without_logarithm();
      if constexpr (law == ElasticLaw::NeoHookean) {
        const double factor = view.mu + view.lambda / 2;
        for (int lane = 0; lane < kLanes; ++lane)
          W[lane] = at.J[lane] > 0
                        ? W[lane] - at.c[lane] * at.c[lane] * at.c[lane] * factor * std::log1p(at.J_1[lane])
                        : std::numeric_limits<double>::infinity();
      }
      sum += batch.weight(q) * W;
    }
    for (int lane = 0; lane < view.n_counted[b]; ++lane) total += sum[lane];
  }
};

template <ElasticLaw law>
struct Forces {
  [[gnu::always_inline]] static void add(const View& view, int b, const double* u, double* f) {
    using V = meshing::AlignedDouble8;
    const Batch<double> batch(view, b, u);
    alignas(64) double sum[kMaxNodes][3][kLanes] = {};
    for (int q = 0; q < view.n_points; ++q) {
      V H[3][3], P[3][3], p[4][3];
      batch.gradient(q, H);
      const LawAt<law, Lanes<double>> at(H, batch.shrinkage_at(q), view.lambda, view.mu, view.kappa);
      at.stress(P);
      V w = batch.weight(q);
      if constexpr (law == ElasticLaw::NeoHookean)
        w = at.J > 0 ? w : V{} + std::numeric_limits<double>::quiet_NaN();
      for (int c = 0; c < 3; ++c) {
        for (int i = 1; i < 4; ++i)
          p[i][c] = w * (P[c][0] * batch.g(i, 0) + P[c][1] * batch.g(i, 1) + P[c][2] * batch.g(i, 2));
        p[0][c] = V{} - (p[1][c] + p[2][c] + p[3][c]);
      }
      const double* l = view.points + 4 * q;
      for (int i = 0; i < 4; ++i)
        for (int c = 0; c < 3; ++c) {
          vector(sum[i][c]) += view.n == 4 ? p[i][c] : (4 * l[i] - 1) * p[i][c];
          for (int j = 0; view.n > 4 && j < 4; ++j)
            if (j != i) vector(sum[kBetween[i][j]][c]) += (4 * l[j]) * p[i][c];
        }
    }
    for (int lane = 0; lane < view.n_lanes[b]; ++lane)
      for (int a = 0; a < view.n; ++a) {
        double* at = f + 3 * static_cast<std::ptrdiff_t>(batch.node[a * kLanes + lane]);
        for (int c = 0; c < 3; ++c) at[c] += sum[a][c][lane];
      }
  }
};

/// Gradients of the shape functions at a point from those of the barycentric coordinates.
template <class Real, class V>
[[gnu::always_inline]] inline void shape_gradients(int n, const double* l, const V (*g)[3], V (*result)[3]) {
  for (int k = 0; k < 3; ++k)
    for (int i = 0; i < 4; ++i) {
      result[i][k] = n == 4 ? g[i][k] : static_cast<Real>(4 * l[i] - 1) * g[i][k];
      for (int j = i + 1; n > 4 && j < 4; ++j)
        result[kBetween[i][j]][k] =
            static_cast<Real>(4 * l[i]) * g[j][k] + static_cast<Real>(4 * l[j]) * g[i][k];
    }
}

/// Eight vectors become those of their first lanes, of their second and so on: three perfect shuffles.
template <class V>
[[gnu::always_inline]] inline void transpose(V* rows) {
  for (int round = 0; round < 3; ++round) {
    V shuffled[8];
    for (int k = 0; k < 4; ++k) {
      shuffled[2 * k] = TESTBED_SHUFFLED(rows[k], rows[k + 4], 0, 8, 1, 9, 2, 10, 3, 11);
      shuffled[2 * k + 1] = TESTBED_SHUFFLED(rows[k], rows[k + 4], 4, 12, 5, 13, 6, 14, 7, 15);
    }
    std::copy_n(shuffled, 8, rows);
  }
}

template <ElasticLaw law>
struct Stiffness {
  template <class Real>
  [[gnu::always_inline]] static void add(const View& view, int b, const double* u, Real* blocks) {
    using V = typename Lanes<Real>::Vector;
    const Batch<Real> batch(view, b, u);
    V g[4][3];  // of the barycentric coordinates
    for (int k = 0; k < 3; ++k) {
      for (int i = 1; i < 4; ++i) g[i][k] = batch.g(i, k);
      g[0][k] = V{} - (g[1][k] + g[2][k] + g[3][k]);
    }
    for (int first = 0; first < view.n_points; first += kPointsAtOnce) {
      const int m = std::min(kPointsAtOnce, view.n_points - first);
      typename LawAt<law, Lanes<Real>>::Tangent t[kPointsAtOnce];
      V G[kPointsAtOnce][kMaxNodes][3], h[kPointsAtOnce][kMaxNodes][3];
      for (int q = 0; q < m; ++q) {
        V H[3][3], pushed[4][3];
        batch.gradient(first + q, H);
        LawAt<law, Lanes<Real>>(H, batch.shrinkage_at(first + q), static_cast<Real>(view.lambda),
                                static_cast<Real>(view.mu), static_cast<Real>(view.kappa))
            .tangent(batch.weight(first + q), t[q]);
        for (int i = 0; i < 4; ++i)
          for (int c = 0; c < 3; ++c)
            pushed[i][c] = t[q].push[c][0] * g[i][0] + t[q].push[c][1] * g[i][1] + t[q].push[c][2] * g[i][2];
        const double* l = view.points + 4 * (first + q);
        shape_gradients<Real>(view.n, l, g, G[q]);
        shape_gradients<Real>(view.n, l, pushed, h[q]);
      }
      const int* place = view.place + static_cast<std::ptrdiff_t>(b) * (view.n * (view.n + 1) / 2) * kLanes;
      for (int a = 0; a < view.n; ++a)
        for (int e = a; e < view.n; ++e, place += kLanes)
          add_block<Real>(view.n_lanes[b], m, t, G, h, a, e, place, blocks);
    }
  }

  /// Of local nodes a and e, at m points.
  template <class Real, class V, class Tangent>
  [[gnu::always_inline]] static void add_block(int n_lanes, int m, const Tangent* t,
                                               const V (*G)[kMaxNodes][3], const V (*h)[kMaxNodes][3], int a,
                                               int e, const int* place, Real* blocks) {
    V block[3][3] = {};  // by columns
    for (int q = 0; q < m; ++q) {
      const V* G_a = G[q][a];
      const V* G_e = G[q][e];
      const V product = G_a[0] * G_e[0] + G_a[1] * G_e[1] + G_a[2] * G_e[2];
      for (int d = 0; d < 3; ++d) {
        const V with_a = t[q].beta * h[q][e][d], with_e = t[q].gamma * h[q][a][d];
        for (int c = 0; c < 3; ++c) {
          block[d][c] += with_a * h[q][a][c] + with_e * h[q][e][c];
          if constexpr (law == ElasticLaw::StVenantKirchhoff) block[d][c] += product * t[q].B[c][d];
        }
      }
      V diagonal = t[q].shear * product;
      if constexpr (law == ElasticLaw::StVenantKirchhoff) {
        diagonal = V{};
        for (int k = 0; k < 3; ++k)
          diagonal +=
              G_a[k] * (t[q].metric[k][0] * G_e[0] + t[q].metric[k][1] * G_e[1] + t[q].metric[k][2] * G_e[2]);
      }
      for (int c = 0; c < 3; ++c) block[c][c] += diagonal;
    }
    V entry[8] = {block[0][0], block[0][1], block[0][2], block[1][0],
                  block[1][1], block[1][2], block[2][0], block[2][1]};
    transpose(entry);
    for (int lane = 0; lane < n_lanes; ++lane) {
      Real* at = blocks + 9 * static_cast<std::ptrdiff_t>(place[lane]);
      vector(at) += entry[lane];
      at[8] += block[2][2][lane];
    }
  }
};

template <template <ElasticLaw> class Pass, class Result>
[[gnu::always_inline]] inline void for_each_batch(const View& view, int begin, int end, const double* u,
                                                  Result&& result) {
  switch (view.law) {
    case ElasticLaw::SmallStrain:
      for (int b = begin; b < end; ++b) Pass<ElasticLaw::SmallStrain>::add(view, b, u, result);
      break;
    case ElasticLaw::StVenantKirchhoff:
      for (int b = begin; b < end; ++b) Pass<ElasticLaw::StVenantKirchhoff>::add(view, b, u, result);
      break;
    case ElasticLaw::NeoHookean:
      for (int b = begin; b < end; ++b) Pass<ElasticLaw::NeoHookean>::add(view, b, u, result);
  }
}

TESTBED_EVERY_WIDTH double energy_of(const View& view, int begin, int end, const double* u) {
  double sum = 0;
  for_each_batch<Energy>(view, begin, end, u, sum);
  return sum;
}

TESTBED_EVERY_WIDTH void add_forces(const View& view, int begin, int end, const double* u, double* f) {
  for_each_batch<Forces>(view, begin, end, u, f);
}

TESTBED_EVERY_WIDTH void add_stiffness(const View& view, int begin, int end, const double* u, float* blocks) {
  for_each_batch<Stiffness>(view, begin, end, u, blocks);
}

TESTBED_EVERY_WIDTH void add_stiffness(const View& view, int begin, int end, const double* u,
                                       double* blocks) {
  for_each_batch<Stiffness>(view, begin, end, u, blocks);
}

/// Smallest power of two that is at least n.
int power_of_two(Eigen::Index n) {
  int result = 1;
  while (result < n) result *= 2;
  return result;
}

}  // namespace

TetBatches::TetBatches(const Matrix3Xd& X, const Eigen::MatrixXi& cells, int n_own,
                       const std::vector<char>& is_ghost)
    : X_(X),
      n_nodes_per_cell_(static_cast<int>(cells.rows())),
      n_tetrahedra_(static_cast<int>(cells.cols())),
      is_subdivided_(X.cols() >= meshing::kLeastSubdivided) {
  number_nodes(X, cells, is_ghost);

  // Along the body: tetrahedra by their subdomain and their first node.
  std::vector<std::array<int, 4>> order;  // subdomain, whether it does not count, lowest rank, tetrahedron
  for (int t = 0; t < n_tetrahedra_; ++t) {
    int low = leaf_[cells(0, t)], high = low, first = rank_[cells(0, t)];
    for (const int i : cells.col(t)) {
      low = std::min(low, leaf_[i]);
      high = std::max(high, leaf_[i]);
      first = std::min(first, rank_[i]);
    }
    order.push_back({{meshing::subdomain_of(low, high), t >= n_own, first, t}});
  }
  std::sort(order.begin(), order.end());

  std::size_t next = 0;
  for (int subdomain = 0; subdomain < meshing::kSubdomains; ++subdomain) {
    first_batch_.push_back(static_cast<int>(n_lanes_.size()));
    while (next < order.size() && order[next][0] == subdomain) {
      const std::size_t first = next;
      while (next < order.size() && next < first + kLanes && order[next][0] == subdomain) ++next;
      const int n_lanes = static_cast<int>(next - first);
      n_lanes_.push_back(n_lanes);
      n_counted_.push_back(static_cast<int>(
          std::count_if(&order[first], &order[first] + n_lanes, [](const auto& of) { return of[1] == 0; })));
      const std::size_t node = node_.size(), geometry = geometry_.size();
      node_.resize(node + static_cast<std::size_t>(n_nodes_per_cell_) * kLanes);
      geometry_.resize(geometry + kGeometry);
      for (int lane = 0; lane < kLanes; ++lane) {
        const auto cell = cells.col(order[lane < n_lanes ? first + lane : first][3]);
        for (int a = 0; a < n_nodes_per_cell_; ++a) node_[node + a * kLanes + lane] = cell(a);
        Eigen::Matrix3d edges;
        for (int i = 0; i < 3; ++i) edges.col(i) = X.col(cell(i + 1)) - X.col(cell(0));
        const Eigen::Matrix3d gradients = edges.inverse();  // a row each
        for (int i = 0; i < 3; ++i)
          for (int k = 0; k < 3; ++k) geometry_[geometry + (3 * i + k) * kLanes + lane] = gradients(i, k);
        geometry_[geometry + 9 * kLanes + lane] = lane < n_lanes ? edges.determinant() / 6 : 0;
      }
    }
  }
  first_batch_.push_back(static_cast<int>(n_lanes_.size()));
  make_pattern(cells);
}

/// A node between leaves belongs to the subdomain that holds both, so that rows of different subdomains of
/// one size have no entries in common. In a subdomain nodes follow finer and finer bisections.
void TetBatches::number_nodes(const Matrix3Xd& X, const Eigen::MatrixXi& cells,
                              const std::vector<char>& is_ghost) {
  constexpr int kNodesPerLeaf = 8;
  const auto n = static_cast<int>(X.cols());
  const int n_leaves = std::max(8, power_of_two(n / kNodesPerLeaf));
  const std::vector<int> fine = meshing::leaves_of(X, n_leaves);
  leaf_.assign(n, 0);
  for (int i = 0; is_subdivided_ && i < n; ++i) leaf_[i] = fine[i] / (n_leaves / 8);
  std::vector<int> subdomain = leaf_;
  for (const auto& cell : cells.colwise())
    for (const int i : cell)
      for (const int j : cell)
        if (leaf_[j] > leaf_[i])
          subdomain[i] = std::max(subdomain[i], meshing::subdomain_of(leaf_[i], leaf_[j]));
  for (int i = 0; i < static_cast<int>(is_ghost.size()) && i < n; ++i)
    if (is_ghost[i]) subdomain[i] = meshing::kSubdomains;
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int i, int j) {
    return std::tie(subdomain[i], fine[i], i) < std::tie(subdomain[j], fine[j], j);
  });
  rank_.resize(n);
  first_row_.assign(meshing::kSubdomains + 1, 0);
  for (int k = 0; k < n; ++k) {
    rank_[order[k]] = k;
    if (subdomain[order[k]] < meshing::kSubdomains) ++first_row_[subdomain[order[k]] + 1];
  }
  std::partial_sum(first_row_.begin(), first_row_.end(), first_row_.begin());
}

void TetBatches::make_pattern(const Eigen::MatrixXi& cells) {
  const auto n = static_cast<int>(rank_.size());
  std::vector<int> start(n + 1), cell_of(cells.size());  // tetrahedra of each rank
  for (const int i : cells.reshaped()) ++start[rank_[i] + 1];
  std::partial_sum(start.begin(), start.end(), start.begin());
  std::vector<int> next(start.begin(), start.end() - 1);
  for (int t = 0; t < n_tetrahedra_; ++t)
    for (const int i : cells.col(t)) cell_of[next[rank_[i]]++] = t;
  std::vector<int> seen(n, -1);
  pattern_.row_start.push_back(0);
  for (int row = 0; row < n; ++row) {
    const auto first = static_cast<std::ptrdiff_t>(pattern_.column.size());
    const auto add = [&](int column) {
      if (seen[column] != row) pattern_.column.push_back(column);
      seen[column] = row;
    };
    add(row);
    for (int k = start[row]; k < start[row + 1]; ++k)
      for (const int i : cells.col(cell_of[k])) add(rank_[i]);
    std::sort(pattern_.column.begin() + first, pattern_.column.end());
    pattern_.row_start.push_back(static_cast<int>(pattern_.column.size()));
  }
  for (int row = 0; row < n; ++row) pattern_.diagonal.push_back(pattern_.find(row, row));
  for (std::size_t b = 0; b < n_lanes_.size(); ++b) {
    const int* node = &node_[b * n_nodes_per_cell_ * kLanes];
    for (int a = 0; a < n_nodes_per_cell_; ++a)
      for (int e = a; e < n_nodes_per_cell_; ++e)
        for (int lane = 0; lane < kLanes; ++lane) {
          const int row = rank_[node[a * kLanes + lane]], column = rank_[node[e * kLanes + lane]];
          place_.push_back(pattern_.find(row, column));
        }
  }
}

void TetBatches::set_law(ElasticLaw law, const LameConstants& lame, const TetRule& rule) {
  law_ = law;
  lambda_ = lame.lambda;
  mu_ = lame.mu;
  kappa_ = lame.kappa;
  rule_ = rule;
  shrinkage_.clear();
}

/// Calls visit(corners, their barycentric coordinates) for the rule's points in the order of shrinkages.
template <class Visit>
void TetBatches::for_each_point(const Visit& visit) const {
  for (std::size_t b = 0; b < n_lanes_.size(); ++b)
    for (const auto& l : rule_.points.colwise())
      for (int lane = 0; lane < kLanes; ++lane) {
        Eigen::Vector4i corners;
        for (int i = 0; i < 4; ++i) corners(i) = node_[(b * n_nodes_per_cell_ + i) * kLanes + lane];
        visit(corners, l);
      }
}

void TetBatches::set_shrinkage(const std::function<double(const Eigen::Vector3d& x)>& shrinkage) {
  shrinkage_.clear();
  if (!shrinkage) return;
  for_each_point([&](const Eigen::Vector4i& corners, const Eigen::Vector4d& l) {
    shrinkage_.push_back(shrinkage(X_(Eigen::all, corners) * l));
  });
}

void TetBatches::interpolate_shrinkage(const Eigen::VectorXd& at_nodes) {
  shrinkage_.clear();
  for_each_point([&](const Eigen::Vector4i& corners, const Eigen::Vector4d& l) {
    shrinkage_.push_back(at_nodes(corners).dot(l));
  });
}

TetBatches::View TetBatches::view() const {
  return {law_,
          n_nodes_per_cell_,
          static_cast<int>(rule_.weights.size()),
          lambda_,
          mu_,
          kappa_,
          node_.data(),
          n_lanes_.data(),
          n_counted_.data(),
          place_.data(),
          geometry_.data(),
          shrinkage_.empty() ? nullptr : shrinkage_.data(),
          rule_.points.data(),
          rule_.weights.data()};
}

/// Calls visit(first batch, last batch + 1, subdomain) for each subdomain.
template <class Visit>
void TetBatches::for_each_part(const Visit& visit) const {
  const auto part = [&](int subdomain) {
    visit(first_batch_[subdomain], first_batch_[subdomain + 1], subdomain);
  };
  if (is_subdivided_)
    meshing::for_each_subdomain(part);
  else
    part(0);
}

double TetBatches::energy(const Matrix3Xd& u) const {
  const View at = view();
  double sums[meshing::kSubdomains] = {};
  for_each_part(
      [&](int begin, int end, int subdomain) { sums[subdomain] = energy_of(at, begin, end, u.data()); });
  return std::accumulate(std::begin(sums), std::end(sums), 0.);
}

void TetBatches::forces(const Eigen::Ref<const Matrix3Xd>& u, Matrix3Xd& f) const {
  const View at = view();
  f.setZero(3, u.cols());
  for_each_part([&](int begin, int end, int) { add_forces(at, begin, end, u.data(), f.data()); });
}

void TetBatches::add_tangent(const Matrix3Xd& u, float* blocks) const {
  const View at = view();
  for_each_part([&](int begin, int end, int) { add_stiffness(at, begin, end, u.data(), blocks); });
}

void TetBatches::add_tangent(const Matrix3Xd& u, double* blocks) const {
  const View at = view();
  for_each_part([&](int begin, int end, int) { add_stiffness(at, begin, end, u.data(), blocks); });
}

void TetBatches::for_each_gradient(const Matrix3Xd& u, const Eigen::Matrix4Xd& points,
                                   const std::function<void(const Eigen::Matrix3d& H)>& visit) const {
  View at = view();
  at.points = points.data();
  at.n_points = static_cast<int>(points.cols());
  at.shrinkage = nullptr;  // of the rule's points
  for (std::size_t b = 0; b < n_lanes_.size(); ++b) {
    const Batch<double> batch(at, static_cast<int>(b), u.data());
    for (int q = 0; q < at.n_points; ++q) {
      meshing::AlignedDouble8 H[3][3];
      batch.gradient(q, H);
      for (int lane = 0; lane < n_lanes_[b]; ++lane) {
        Eigen::Matrix3d of_lane;
        for (int i = 0; i < 3; ++i)
          for (int k = 0; k < 3; ++k) of_lane(i, k) = H[i][k][lane];
        visit(of_lane);
      }
    }
  }
}

std::vector<char> rows_of(const TetBatches& tets, const std::vector<char>& of_nodes) {
  std::vector<char> rows(3 * tets.rank().size());
  for (size_t k = 0; k < rows.size(); ++k) rows[3 * tets.rank()[k / 3] + k % 3] = of_nodes[k];
  return rows;
}

}  // namespace testbed::fem
