#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "meshing/base/random.h"
#include "meshing/network/network.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {

namespace {

/// Candidates rejected in a row before a cell counts as full.
constexpr int kMostMisses = 30;
constexpr double kMostCells = 2e9;
/// Internal nodes for each of the surface, unless more are asked for.
constexpr int kMostPerVertex = 3;

/// The bounding box cut into cubes ("quadrants") no smaller than phi, each with the list of its nodes.
class HashGrid {
 public:
  HashGrid(const Eigen::AlignedBox3d& box, double cell, double phi)
      : low_(box.min()), cell_(cell), phi2_(phi * phi) {
    const Eigen::Array3d n = (box.sizes() / cell).array().floor() + 1;
    if (!(n.prod() < kMostCells))
      throw std::runtime_error("phi gives a grid of " + std::to_string(n.prod()) +
                               " cells, expected at most 2e9");
    n_ = n.cast<int>();
    first_.assign(static_cast<size_t>(n.prod()), -1);
  }

  const Eigen::Array3i& size() const { return n_; }
  double cell() const { return cell_; }
  Eigen::Vector3d corner(const Eigen::Array3i& c) const { return low_ + cell_ * c.matrix().cast<double>(); }

  bool is_free(const Eigen::Array3i& c, const Eigen::Vector3d& x) const {
    const Eigen::Array3i from = (c - 1).max(0), to = (c + 1).min(n_ - 1);
    for (int k = from[2]; k <= to[2]; ++k)
      for (int j = from[1]; j <= to[1]; ++j)
        for (int i = from[0]; i <= to[0]; ++i)
          for (int node = first_[index({i, j, k})]; node >= 0; node = next_[node])
            if ((nodes_[node] - x).squaredNorm() < phi2_) return false;
    return true;
  }

  void add(const Eigen::Array3i& c, const Eigen::Vector3d& x) {
    next_.push_back(first_[index(c)]);
    first_[index(c)] = static_cast<int>(nodes_.size());
    nodes_.push_back(x);
  }

  const std::vector<Eigen::Vector3d>& nodes() const { return nodes_; }

 private:
  size_t index(const Eigen::Array3i& c) const {
    return (static_cast<size_t>(c[2]) * n_[1] + c[1]) * n_[0] + c[0];
  }

  Eigen::Vector3d low_;
  double cell_, phi2_;
  Eigen::Array3i n_;
  std::vector<int> first_, next_;
  std::vector<Eigen::Vector3d> nodes_;
};

/// A cell where a node may still fit.
struct OpenCell {
  Eigen::Array3i at;
  bool is_deep;  ///< every point of it is deep enough: no need to ask the surface
  int n_missed;
};

/// Collects the cells of the block [from, to) that reach down to
/// the depth psi, halving blocks that are neither wholly in nor out.
void collect_open_cells(const HashGrid& grid, const SurfaceTree& tree, double psi, const Eigen::Array3i& from,
                        const Eigen::Array3i& to, std::vector<OpenCell>& open) {
  const Eigen::Vector3d low = grid.corner(from), high = grid.corner(to);
  const double depth = tree.depth((low + high) / 2), reach = (high - low).norm() / 2 * (1 + 1e-12);
  if (depth + reach < psi) return;
  const bool is_deep = depth - reach >= psi;
  if (is_deep || (to - from).maxCoeff() == 1) {
    for (int k = from[2]; k < to[2]; ++k)
      for (int j = from[1]; j < to[1]; ++j)
        for (int i = from[0]; i < to[0]; ++i) open.push_back({{i, j, k}, is_deep, 0});
    return;
  }
  int axis;
  (to - from).maxCoeff(&axis);
  Eigen::Array3i middle_to = to, middle_from = from;
  middle_to[axis] = middle_from[axis] = (from[axis] + to[axis]) / 2;
  collect_open_cells(grid, tree, psi, from, middle_to, open);
  collect_open_cells(grid, tree, psi, middle_from, to, open);
}

/// Points in the body until it is full or has `most`.
std::vector<Eigen::Vector3d> throw_darts(const SurfaceTree& tree, const Eigen::AlignedBox3d& box, double cell,
                                         double phi, double psi, int most, std::uint64_t seed) {
  HashGrid grid(box, cell, phi);
  std::vector<OpenCell> open;
  collect_open_cells(grid, tree, psi, {0, 0, 0}, grid.size(), open);
  Random random(seed);
  while (!open.empty() && static_cast<int>(grid.nodes().size()) < most) {
    OpenCell& cell_drawn = open[random.below(open.size())];
    Eigen::Vector3d x = grid.corner(cell_drawn.at);
    for (int axis = 0; axis < 3; ++axis) x[axis] += grid.cell() * random.uniform();
    if (grid.is_free(cell_drawn.at, x) && (cell_drawn.is_deep || tree.depth(x) >= psi)) {
      grid.add(cell_drawn.at, x);
      cell_drawn.n_missed = 0;
    } else if (++cell_drawn.n_missed == kMostMisses) {
      cell_drawn = open.back();
      open.pop_back();
    }
  }
  return grid.nodes();
}

/// The points along a Morton curve: neighbours in space are neighbours
/// in memory, which doubles the speed of all that comes after.
Eigen::Matrix3Xd in_morton_order(const std::vector<Eigen::Vector3d>& points, const Eigen::AlignedBox3d& box) {
  constexpr int kBits = 21;
  std::vector<std::pair<std::uint64_t, int>> order;
  for (const Eigen::Vector3d& x : points) {
    const Eigen::Array3d fraction = (x - box.min()).array() / box.sizes().maxCoeff();
    std::uint64_t code = 0;
    for (int bit = kBits - 1; bit >= 0; --bit)
      for (int axis = 0; axis < 3; ++axis)
        code = 2 * code + (static_cast<std::uint64_t>(fraction[axis] * ((1 << kBits) - 1)) >> bit & 1);
    order.emplace_back(code, static_cast<int>(order.size()));
  }
  std::sort(order.begin(), order.end());
  Eigen::Matrix3Xd sorted(3, points.size());
  for (size_t i = 0; i < points.size(); ++i) sorted.col(i) = points[order[i].second];
  return sorted;
}

double smallest_side(const SurfaceMesh& surface) {
  return (surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff()).minCoeff();
}

}  // namespace

SampleOptions fill_spacing(const SurfaceMesh& surface, SampleOptions options) {
  const Eigen::Matrix2Xi E = edges_of(surface.F);
  const double edge =
      (surface.X(Eigen::all, E.row(0)) - surface.X(Eigen::all, E.row(1))).colwise().norm().mean();
  // Half the thickness of a plate, a third of a ball's radius: edges may be longer than the body is thick.
  const double thickness = volume(surface.X, surface.F) / area(surface.X, surface.F);
  const double side = smallest_side(surface);
  if (!options.phi) options.phi = std::min(edge, thickness) / side;
  if (!options.psi) options.psi = std::min(edge, thickness) / 2 / side;
  return options;
}

Eigen::Matrix3Xd sample_interior(const SurfaceMesh& surface, const SampleOptions& wanted,
                                 SampleReport* report) {
  const SampleOptions options = fill_spacing(surface, wanted);
  const double side = smallest_side(surface), psi = *options.psi * side;
  double phi = *options.phi * side;
  if (!(phi > 0)) throw std::runtime_error("phi = " + std::to_string(*options.phi) + ", expected > 0");
  if (!(psi >= 0)) throw std::runtime_error("psi = " + std::to_string(*options.psi) + ", expected >= 0");
  if (options.k && *options.k < 0)
    throw std::runtime_error("k = " + std::to_string(*options.k) + ", expected >= 0");
  const SurfaceTree tree(surface);
  const Eigen::AlignedBox3d box(surface.X.rowwise().minCoeff(), surface.X.rowwise().maxCoeff());
  std::vector<Eigen::Vector3d> nodes;
  std::optional<int> bound;
  if (wanted.k || wanted.phi) {
    const int most = options.k.value_or(std::numeric_limits<int>::max());
    if (most == 0) return {};
    // With few nodes wanted, cells larger than phi hold no more than a few either.
    const double cell = std::max(phi, options.k ? std::cbrt(box.volume() / (8.0 * most)) : 0);
    nodes = throw_darts(tree, box, cell, phi, psi, most, options.seed);
  } else {
    constexpr double kGrowth = 1.1;
    // No body holds as few as a fifth of its volume over phi cubed, so that smaller phi need no trial.
    const int most = kMostPerVertex * static_cast<int>(surface.X.cols());
    const double least = std::cbrt(volume(surface.X, surface.F) / (5.0 * most));
    if (least > phi) bound = most;
    phi = std::max(phi, least);
    while (static_cast<int>((nodes = throw_darts(tree, box, phi, phi, psi, most + 1, options.seed)).size()) >
           most) {
      bound = most;
      phi *= kGrowth;
    }
  }
  if (report) *report = {phi / side, *options.psi, bound};
  Eigen::Matrix3Xd darts = in_morton_order(nodes, box);
  if (options.sampling == Sampling::Darts) return darts;
  return relax_interior(surface, darts, psi, options.seed, options.sampling == Sampling::Graded);
}

}  // namespace testbed::meshing
