// The surface against itself: vertices against triangles and edges against edges, kept apart by a penalty.
#pragma once

#include <array>

#include "massspring/model/model.h"

namespace testbed::massspring {

/// Four nodes and what is between them: e = sum w_a x_a
/// joins the nearest points of two of the surface's parts.
struct NearPair {
  std::array<int, 4> node;
  std::array<double, 4> weight;
  Eigen::Vector3d normal;  ///< from the second part to the first, as they lay when they met
  double stiffness = 0;    ///< N/m
};

/// Energy 1/2 k (D - d)^2 [(27)] of every pair closer than the thickness D. Their distance d is negative
/// where they have passed through each other since they met. Pairs that share a node or are as close at rest
/// do not count.
class SurfaceContact {
 public:
  /// @param thickness  D (m); k is Young's modulus times the surface's mean edge
  SurfaceContact(const MassSpringModel& model, double thickness);

  /// A step begins at positions x (3 x n, m). Remembers on which side of each other pairs lie.
  /// Looks for pairs again when nodes have moved so far that new ones may have met.
  void begin_step(const Eigen::Matrix3Xd& x);

  double energy(const Eigen::Matrix3Xd& x) const;                         ///< J
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const;  ///< N

  /// Pairs in contact; sum of stiffness times (w_a n)(w_b n)^T
  /// is the positive semidefinite part of the Hessian.
  std::vector<NearPair> touching(const Eigen::Matrix3Xd& x) const;

 private:
  struct Pair {
    std::array<int, 4> node;
    bool is_edges;         ///< edge 0-1 and edge 2-3; else vertex 0 and triangle 1-2-3
    Eigen::Vector3d side;  ///< direction of e when they were last apart
  };
  struct Smoothing {
    double m;
    Eigen::Vector3d by_u, by_v;  ///< derivatives by the edges 0-1 and 2-3
  };
  Smoothing smoothing_of(const Pair& pair, const Eigen::Matrix3Xd& x) const;
  template <class Visit>
  void for_each_near(const Eigen::Matrix3Xd& x, const Visit& visit) const;
  void find_pairs(const Eigen::Matrix3Xd& x);

  Eigen::Matrix3Xd X_;
  Eigen::Matrix3Xi F_;
  Eigen::Matrix2Xi E_;
  double thickness_, stiffness_;
  double margin_;            ///< beyond the thickness up to which pairs are listed (m)
  Eigen::Matrix3Xd listed_;  ///< where the nodes were when pairs were listed
  std::vector<Pair> pairs_;
};

}  // namespace testbed::massspring
