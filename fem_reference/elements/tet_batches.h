// Forces, energy and stiffness of straight tetrahedra of degree 1 or 2, eight of them side by side.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <vector>

#include "fem_reference/elements/laws.h"
#include "meshing/algebra/block_matrix.h"

namespace testbed::fem {

/// Points of a quadrature rule on a tetrahedron.
struct TetRule {
  Eigen::Matrix4Xd points;  ///< barycentric coordinates
  Eigen::VectorXd weights;  ///< their sum is 1
};

/// A body's tetrahedra in batches, and the pattern of their stiffness. Fields are over nodes as they were
/// given; rows of matrices are over ranks, which number the nodes along the body, so that neighbours are near
/// in memory. Tetrahedra and rows belong to subdomains [meshing/algebra/subdomains.h], which threads share:
/// results are the same on any number of them.
class TetBatches {
 public:
  /// @param X      3 x n nodes (m)
  /// @param cells  4 or 10 nodes per tetrahedron, in VTK's order
  /// @param n_own  tetrahedra whose energy counts, the first: that of the others is another process'
  /// @param is_ghost  nodes whose rows are not complete, as another process owns them, have the last ranks and belong to
  /// no subdomain; empty: none
  TetBatches(const Eigen::Matrix3Xd& X, const Eigen::MatrixXi& cells,
             int n_own = std::numeric_limits<int>::max(), const std::vector<char>& is_ghost = {});

  void set_law(ElasticLaw law, const LameConstants& lame, const TetRule& rule);
  /// Stress-free shrinkage at the points of the rule; empty: none.
  void set_shrinkage(const std::function<double(const Eigen::Vector3d& x)>& shrinkage);
  /// The same linear in each tetrahedron, from its values at nodes, of which corners count.
  void interpolate_shrinkage(const Eigen::VectorXd& at_nodes);

  /// Elastic energy of displacements u, 3 x n (J), of the tetrahedra that count; infinite where the law has none.
  double energy(const Eigen::Matrix3Xd& u) const;
  /// Its gradient, 3 x n (N); not a number where the energy is infinite.
  void forces(const Eigen::Ref<const Eigen::Matrix3Xd>& u, Eigen::Matrix3Xd& f) const;
  /// Adds its second derivative to blocks of the pattern, 9 numbers each by columns: that of two nodes to
  /// either of their two blocks [symmetrise].
  void add_tangent(const Eigen::Matrix3Xd& u, float* blocks) const;
  void add_tangent(const Eigen::Matrix3Xd& u, double* blocks) const;
  /// Calls visit(grad u) at points of every tetrahedron.
  /// @param points  barycentric coordinates
  void for_each_gradient(const Eigen::Matrix3Xd& u, const Eigen::Matrix4Xd& points,
                         const std::function<void(const Eigen::Matrix3d& H)>& visit) const;
  const TetRule& rule() const { return rule_; }

  /// Without blocks.
  const BlockMatrix& pattern() const { return pattern_; }
  const std::vector<int>& rank() const { return rank_; }  ///< of each node
  /// Where the rows of each subdomain begin, and their end, from where ghosts follow.
  const std::vector<int>& first_row() const { return first_row_; }
  bool is_subdivided() const { return is_subdivided_; }
  int n_tetrahedra() const { return n_tetrahedra_; }

  struct View;

 private:
  void number_nodes(const Eigen::Matrix3Xd& X, const Eigen::MatrixXi& cells,
                    const std::vector<char>& is_ghost);
  void make_pattern(const Eigen::MatrixXi& cells);
  View view() const;
  template <class Visit>
  void for_each_point(const Visit& visit) const;
  template <class Visit>
  void for_each_part(const Visit& visit) const;

  Eigen::Matrix3Xd X_;
  int n_nodes_per_cell_, n_tetrahedra_;
  bool is_subdivided_;
  std::vector<int> leaf_, rank_, first_row_;
  std::vector<int> first_batch_;  // of each subdomain
  std::vector<int> n_lanes_;      // of each batch: its tetrahedra, the rest repeat the first with volume 0
  std::vector<int> n_counted_;    // of these in the energy, the first
  std::vector<int> node_;         // eight of each local node of each batch
  std::vector<double> geometry_;  // of each batch: gradients of barycentric coordinates 1 to 3, volumes
  std::vector<int> place_;        // of the blocks of pairs of local nodes
  std::vector<double> shrinkage_;
  BlockMatrix pattern_;
  ElasticLaw law_ = ElasticLaw::SmallStrain;
  double lambda_ = 0, mu_ = 0, kappa_ = 0;
  TetRule rule_;
};

/// Of matrices over ranks, from a mark of each unknown 3 node + component, of which corners of tetrahedra come first.
std::vector<char> rows_of(const TetBatches& tets, const std::vector<char>& of_nodes);

}  // namespace testbed::fem
