#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <string>

#include "meshing/base/kd_tree.h"
#include "meshing/network/network.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {

namespace {

/// The state of figure 8's queue. Nodes still in `tree` are those a white node may project to.
class Propagation {
 public:
  Propagation(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior, const PcpOptions& options)
      : options_(options),
        n_surface_(static_cast<int>(surface.X.cols())),
        n_black_(static_cast<int>(interior.cols())),
        tree_(interior),
        degree_(n_surface_ + interior.cols(), 0),
        is_black_(interior.cols(), true) {
    X_.resize(3, n_surface_ + interior.cols());
    X_ << surface.X, interior;
    const Eigen::Matrix2Xi edges = edges_of(surface.F);
    for (const auto& e : edges.colwise()) link(e[0], e[1]);
    if (options.degree_weight == 0 && options.depth_weight == 0) return;
    const SurfaceTree depths(surface);
    for (const auto& x : interior.colwise()) depth_.push_back(depths.depth(x));
  }

  std::vector<int> run() {
    std::vector<int> white(n_surface_), white_per_stage;
    std::iota(white.begin(), white.end(), 0);
    while (n_black_ > 0) {
      std::vector<int> gray;
      int n_dequeued = 0;
      for (int w : white) {
        if (n_black_ == 0 && options_.reading != PcpReading::WholeLastStage) break;
        ++n_dequeued;
        project(w, gray);
      }
      if (options_.reading != PcpReading::Literal) {
        std::sort(gray.begin(), gray.end());
        for (int g : gray) tree_.remove(g - n_surface_);
      }
      white_per_stage.push_back(n_dequeued);
      white = std::move(gray);
    }
    return white_per_stage;
  }

  SpringNetwork network(const SurfaceMesh& surface) const {
    SpringNetwork network{X_, surface.F, Eigen::Matrix2Xi(2, springs_.size()), {}, n_surface_};
    for (size_t s = 0; s < springs_.size(); ++s) network.E.col(s) << springs_[s].first, springs_[s].second;
    return network;
  }

 private:
  void link(int i, int j) {
    springs_.emplace_back(std::min(i, j), std::max(i, j));
    ++degree_[i];
    ++degree_[j];
  }

  /// The best by the priority, best first: among the nearest that no farther one can beat.
  std::vector<int> targets_of(int white) const {
    const Eigen::Vector3d x = X_.col(white);
    const auto nearest = [&](int k) {
      return tree_.nearest(x, k, [&](int target) { return degree_[n_surface_ + target]; });
    };
    const size_t n = options_.multiplicity;
    if (depth_.empty()) return nearest(options_.multiplicity);
    for (size_t k = 2 * n;; k *= 2) {
      const std::vector<int> near = nearest(static_cast<int>(k));
      std::vector<std::pair<double, size_t>> ranked;
      double farthest = 0;
      for (size_t i = 0; i < near.size(); ++i) {
        farthest = (X_.col(n_surface_ + near[i]) - x).norm();
        ranked.emplace_back(farthest + options_.degree_weight * degree_[n_surface_ + near[i]] +
                                options_.depth_weight * depth_[near[i]],
                            i);
      }
      std::sort(ranked.begin(), ranked.end());
      if (near.size() == k && ranked[n - 1].first > farthest) continue;
      std::vector<int> targets;
      for (size_t i = 0; i < std::min(n, ranked.size()); ++i) targets.push_back(near[ranked[i].second]);
      return targets;
    }
  }

  void project(int white, std::vector<int>& gray) {
    for (int target : targets_of(white)) {
      link(white, n_surface_ + target);
      if (!is_black_[target]) continue;
      is_black_[target] = false;
      gray.push_back(n_surface_ + target);
      if (options_.reading == PcpReading::Literal) tree_.remove(target);  // white at once
      if (--n_black_ == 0 && options_.reading != PcpReading::WholeLastStage) return;
    }
  }

  PcpOptions options_;
  int n_surface_, n_black_;
  KdTree tree_;
  Eigen::Matrix3Xd X_;
  std::vector<int> degree_;
  std::vector<double> depth_;  ///< of inner nodes (m); empty: the priority is distance alone
  std::vector<bool> is_black_;
  std::vector<std::pair<int, int>> springs_;
};

}  // namespace

SpringNetwork link_pcp(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                       const PcpOptions& options, PcpReport* report) {
  if (options.multiplicity < 3)
    throw std::runtime_error("multiplicity = " + std::to_string(options.multiplicity) +
                             ", expected at least 3");
  if (options.degree_weight < 0 || options.depth_weight < 0)
    throw std::runtime_error("weights of PCP's priority, expected none below 0");
  Propagation propagation(surface, interior, options);
  const std::vector<int> white_per_stage = propagation.run();
  if (report) report->white_per_stage = white_per_stage;
  return propagation.network(surface);
}

}  // namespace testbed::meshing
