#include "meshing/network/split_in_eight.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "meshing/surface/cut_surface.h"

namespace testbed::meshing {
namespace {

/// Numbers the middles of edges as they are asked for.
class Middles {
 public:
  explicit Middles(int first) : first_(first) {}

  int operator()(int a, int b) {
    if (a > b) std::swap(a, b);
    const auto key = static_cast<std::int64_t>(a) << 32 | b;
    const auto [found, is_new] = number_.emplace(key, first_ + static_cast<int>(ends_.size()));
    if (is_new) ends_.emplace_back(a, b);
    return found->second;
  }

  const std::vector<Eigen::Vector2i>& ends() const { return ends_; }

 private:
  int first_;
  std::unordered_map<std::int64_t, int> number_;
  std::vector<Eigen::Vector2i> ends_;
};

/// The surface's triangles in four, each with its parts in a row.
/// @param middle  of edges, which are numbered on from the vertices
SurfaceMesh split_in_four(const SpringNetwork& network, Middles& middle) {
  const Eigen::Index n = network.n_surface, m = network.F.cols();
  const bool is_cut = network.cuts.F.size() > 0;
  SurfaceMesh after{{}, Eigen::Matrix3Xi(3, 4 * m), {is_cut ? network.cuts.F : network.F, {}, {}}};
  Cuts& cuts = after.cuts;
  cuts.parent.resize(4 * m);
  cuts.between.resize(3, n + 3 * m / 2);
  cuts.between.leftCols(n) =
      is_cut ? network.cuts.between : Eigen::RowVectorXi::LinSpaced(n, 0, n - 1).replicate(3, 1);
  for (Eigen::Index f = 0; f < m; ++f) {
    const int parent = is_cut ? network.cuts.parent[f] : static_cast<int>(f);
    cuts.parent.segment<4>(4 * f).setConstant(parent);
    std::array<int, 3> halves{};
    for (int c = 0; c < 3; ++c) {
      const int a = network.F(c, f), b = network.F((c + 1) % 3, f);
      halves[c] = middle(a, b);
      cuts.between.col(halves[c]) =
          between_halves(cuts.between.col(a), cuts.between.col(b), cuts.F.col(parent));
    }
    const auto& [ab, bc, ca] = halves;
    const int a = network.F(0, f), b = network.F(1, f), c = network.F(2, f);
    after.F.middleCols<4>(4 * f).transpose() << a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca;
  }
  return after;
}

}  // namespace

SplitNetwork split_in_eight(const SpringNetwork& network) {
  const auto& [X, F, E, T, n_surface, cuts] = network;
  // Nodes after: the surface's, the middles of its edges, then those inside and the middles of all other edges.
  Middles middle(n_surface);
  const SurfaceMesh surface = split_in_four(network, middle);
  const auto n_new = static_cast<int>(middle.ends().size()), n_after = n_surface + n_new;
  const auto n_inside = static_cast<int>(X.cols()) - n_surface;
  const auto after = [&](int node) { return node < n_surface ? node : node + n_new; };
  const auto half = [&](int a, int b) {
    const int m = middle(a, b);
    return m < n_after ? m : m + n_inside;
  };
  Eigen::Matrix4Xi T_after(4, 8 * T.cols());
  for (Eigen::Index k = 0; k < T.cols(); ++k) {
    const Eigen::Vector4i t = T.col(k);
    const int a = after(t[0]), b = after(t[1]), c = after(t[2]), d = after(t[3]);
    const int ab = half(t[0], t[1]), ac = half(t[0], t[2]), ad = half(t[0], t[3]), bc = half(t[1], t[2]),
              bd = half(t[1], t[3]), cd = half(t[2], t[3]);
    // Each diagonal, and the four other corners around it.
    const std::array<std::array<int, 6>, 3> diagonals{
        {{ab, cd, ac, ad, bd, bc}, {ac, bd, bc, cd, ad, ab}, {ad, bc, ab, ac, cd, bd}}};
    const std::array<double, 3> length{(X.col(t[0]) + X.col(t[1]) - X.col(t[2]) - X.col(t[3])).squaredNorm(),
                                       (X.col(t[0]) + X.col(t[2]) - X.col(t[1]) - X.col(t[3])).squaredNorm(),
                                       (X.col(t[0]) + X.col(t[3]) - X.col(t[1]) - X.col(t[2])).squaredNorm()};
    const auto& [p, q, r0, r1, r2, r3] =
        diagonals[std::min_element(length.begin(), length.end()) - length.begin()];
    T_after.middleCols<8>(8 * k).transpose() << a, ab, ac, ad, ab, b, bc, bd, ac, bc, c, cd, ad, bd, cd, d, p,
        q, r0, r1, p, q, r1, r2, p, q, r2, r3, p, q, r3, r0;
  }
  SplitNetwork split;
  split.between.resize(2, X.cols() + static_cast<Eigen::Index>(middle.ends().size()));
  for (int i = 0; i < X.cols(); ++i) split.between.col(after(i)).setConstant(i);
  for (int m = 0; m < static_cast<int>(middle.ends().size()); ++m)
    split.between.col(m < n_new ? n_surface + m : n_surface + m + n_inside) = middle.ends()[m];
  split.network = {interpolated(X, split.between), surface.F, {}, T_after, n_after, surface.cuts};
  return split;
}

Eigen::Matrix3Xd interpolated(const Eigen::Matrix3Xd& field, const Eigen::Matrix2Xi& between) {
  Eigen::Matrix3Xd result(3, between.cols());
  for (Eigen::Index i = 0; i < between.cols(); ++i)
    result.col(i) = (field.col(between(0, i)) + field.col(between(1, i))) / 2;
  return result;
}

}  // namespace testbed::meshing
