#include <Eigen/Dense>
#include <algorithm>
#include <deque>

#include "meshing/base/kd_tree.h"
#include "meshing/network/connect.h"
#include "meshing/network/rigidity.h"

namespace testbed::meshing {

namespace {

/// The parts of a network known to be rigid, grown node by node.
class RigidPart {
 public:
  RigidPart(const SurfaceMesh& surface, const SurfaceTree& tree, const Eigen::Matrix3Xd& X,
            std::vector<std::pair<int, int>>& springs)
      : X_(X),
        surface_tree_(tree),
        n_surface_(static_cast<int>(surface.X.cols())),
        springs_(springs),
        neighbours_(X.cols()),
        is_tied_(X.cols(), false),
        n_ties_(X.cols(), 0),
        spread_(X.cols(), Eigen::Matrix3d::Zero()),
        nodes_(X) {
    for (const auto& [i, j] : springs_) {
      neighbours_[i].push_back(j);
      neighbours_[j].push_back(i);
    }
  }

  bool is_tied(int node) const { return is_tied_[node]; }

  /// A triangle is rigid in itself.
  void start(const Eigen::Vector3i& triangle) {
    for (int v : triangle) is_tied_[v] = true;
    for (int v : triangle) tie_neighbours(v);
    grow();
  }

  /// Is content with less independent directions from now on:
  /// in a narrow wedge of the body there are no better ones.
  void lower_bracing() {
    enough_ /= 10;
    for (size_t i = 0; i < n_ties_.size(); ++i)
      if (!is_tied_[i] && n_ties_[i] > 0) frontier_.push_back(static_cast<int>(i));
  }

  /// Links nodes of the finished part until six springs hold
  /// each in independent directions, as far as the body allows.
  void strengthen() {
    enough_ = kLeastBracing;
    least_ties_ = 6;
    for (int i = 0; i < X_.cols(); ++i) {
      spread_[i].setZero();
      n_ties_[i] = 0;
      for (int other : neighbours_[i]) add_direction(i, other);
      brace(i);
    }
  }

  /// Ties one more node beside the part by new links; false where none can be.
  bool extend() {
    while (!frontier_.empty()) {
      const int node = frontier_.front();
      frontier_.pop_front();
      if (is_tied_[node] || !brace(node)) continue;
      tie(node);
      grow();
      return true;
    }
    return false;
  }

 private:
  double bracing(int node) const {
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(spread_[node], Eigen::EigenvaluesOnly);
    return solver.eigenvalues()[0];
  }

  bool is_held(int node) const { return n_ties_[node] >= least_ties_ && bracing(node) >= enough_; }

  void add_direction(int node, int to) {
    const Eigen::Vector3d d = (X_.col(to) - X_.col(node)).normalized();
    spread_[node] += d * d.transpose();
    ++n_ties_[node];
  }

  void tie(int node) {
    is_tied_[node] = true;
    tie_neighbours(node);
  }

  void tie_neighbours(int node) {
    for (int other : neighbours_[node]) {
      if (is_tied_[other]) continue;
      add_direction(other, node);
      if (n_ties_[other] == 1) frontier_.push_back(other);
      if (is_held(other)) ready_.push_back(other);
    }
  }

  void grow() {
    while (!ready_.empty()) {
      const int node = ready_.front();
      ready_.pop_front();
      if (!is_tied_[node]) tie(node);
    }
  }

  /// Links a node to the nearest tied ones until these springs span space.
  bool brace(int node) {
    constexpr int kFewest = 32, kMost = 2048;
    if (is_held(node)) return true;
    for (int k = kFewest; k <= kMost; k *= 2)
      for (int other : nodes_.nearest(X_.col(node), k)) {
        const auto& known = neighbours_[node];
        if (!is_tied_[other] || std::find(known.begin(), known.end(), other) != known.end() ||
            !is_inside(surface_tree_, X_, n_surface_, node, other))
          continue;
        springs_.emplace_back(std::min(node, other), std::max(node, other));
        neighbours_[node].push_back(other);
        neighbours_[other].push_back(node);
        add_direction(node, other);
        if (is_held(node)) return true;
      }
    return false;
  }

  const Eigen::Matrix3Xd& X_;
  const SurfaceTree& surface_tree_;
  int n_surface_;
  double enough_ = kLeastBracing;
  int least_ties_ = 3;
  std::vector<std::pair<int, int>>& springs_;
  std::vector<std::vector<int>> neighbours_;
  std::vector<bool> is_tied_;
  std::vector<int> n_ties_;              ///< springs to tied nodes
  std::vector<Eigen::Matrix3d> spread_;  ///< sum of n n^T over them
  std::deque<int> ready_, frontier_;
  KdTree nodes_;
};

}  // namespace

std::vector<int> make_rigid(const SurfaceMesh& surface, const SurfaceTree& tree, const Eigen::Matrix3Xd& X,
                            std::vector<std::pair<int, int>>& springs) {
  RigidPart part(surface, tree, X, springs);
  for (const auto& f : surface.F.colwise()) {
    // A triangle with no tied vertex lies on another solid.
    if (part.is_tied(f[0]) || part.is_tied(f[1]) || part.is_tied(f[2])) continue;
    part.start(f);
    while (part.extend()) {
    }
  }
  constexpr int kTimesLower = 3;  // down to 5e-5: beyond, rounding makes the proof void
  for (int times = 0; times < kTimesLower; ++times) {
    part.lower_bracing();
    while (part.extend()) {
    }
  }
  part.strengthen();
  std::vector<int> loose;
  for (int i = 0; i < X.cols(); ++i)
    if (!part.is_tied(i)) loose.push_back(i);
  return loose;
}

}  // namespace testbed::meshing
