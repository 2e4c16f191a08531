// A process' share of a mesh, and what processes tell each other of its nodes.
#pragma once

#include <Eigen/Core>
#include <unordered_map>
#include <utility>
#include <vector>

#include "fem_reference/base/processes.h"
#include "meshing/base/mesh.h"

namespace testbed::fem {

/// Nodes of a degree: the vertices of the mesh, then (degree 2) the middles of its edges.
struct Nodes {
  int n_vertices = 0;
  Eigen::Matrix2Xi edges;  ///< ends of edge e, whose middle is node n_vertices + e
  Eigen::Matrix3Xd X;
  Eigen::MatrixXi cells, faces;

  Nodes(const TetMesh& mesh, int degree);
  /// Node in the middle of an edge.
  int middle(int a, int b) const { return middle_.at(key(a, b)); }

 private:
  static std::uint64_t key(int a, int b) {
    return static_cast<std::uint64_t>(std::min(a, b)) << 32 | static_cast<std::uint32_t>(std::max(a, b));
  }
  std::unordered_map<std::uint64_t, int> middle_;
};

/// Brings the values of nodes that other processes own up to date.
class Exchange {
 public:
  Exchange() = default;  ///< of one process, which owns all
  /// @param number  of each node in the whole mesh
  /// @param owner   of each node
  Exchange(const std::vector<int>& number, const std::vector<int>& owner);
  /// The same for fields over ranks; nodes without a rank are left out.
  Exchange over(const std::vector<int>& rank) const;

  /// Fields over nodes or ranks, a column each.
  void update(Eigen::Matrix3Xd& u) const;
  void update(Eigen::Matrix4Xf& u) const;

 private:
  struct Neighbour {
    int process;
    std::vector<int> sent, received;  // columns
  };
  template <class Field>
  void update_columns(Field& u) const;

  std::vector<Neighbour> neighbours_;
};

/// The nodes that a process owns and all tetrahedra at them, with the ghosts, nodes of others, that these have besides.
/// Rows of owned nodes need no other process.
struct Share {
  /// Of one process: the whole.
  Share(TetMesh whole);

  bool is_whole = true;
  TetMesh
      mesh;  ///< its vertices are in the order of the whole mesh; boundary triangles are those at owned nodes
  int n_own;         ///< tetrahedra that no other process counts, the first
  int n_tetrahedra;  ///< of the whole mesh, as the next
  int n_nodes = 0;
  double volume = 0;           ///< m3
  std::vector<int> face;       ///< of the whole mesh, of each boundary triangle; empty: the same
  std::vector<int> number;     ///< in the whole mesh, of each of Nodes(mesh, degree); empty: the same
  std::vector<char> is_ghost;  ///< of these; empty: none
  Exchange exchange;
  Eigen::MatrixXi faces;  ///< of several processes, on all: the whole mesh's

  /// Number here of each node of the whole mesh that is here.
  std::unordered_map<int, int> local() const;
  /// Of nodes of the whole mesh, those that this process owns, by their numbers here.
  std::vector<int> owned(const std::vector<int>& nodes) const;
  /// As meshing::rigid_motions, about the mean of all; X 3 x n over the first nodes (m).
  Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X) const;
  /// Over all nodes, once each.
  double dot(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& w) const;
  double norm(const Eigen::Matrix3Xd& u) const;
  /// Of what joins these nodes, whether no other process counts it.
  bool counts(const Eigen::VectorXi& nodes) const;
  /// Zero where others own.
  void clear_ghosts(Eigen::Matrix3Xd& u) const;
  /// On the first of several processes a field over the whole mesh's first n nodes.
  Eigen::Matrix3Xd gather(const Eigen::Matrix3Xd& u, int n) const;

  /// What a process writes: the nodes that are here, on the first of several behind the whole mesh's first n.
  /// @return their numbers in the whole mesh; empty: the same
  std::vector<int> written_nodes(int n) const;
  /// A field over these. All processes call it.
  Eigen::Matrix3Xd written(const Eigen::Matrix3Xd& u, int n) const;
  /// Places among these of the nodes of tetrahedra that this process counts.
  Eigen::MatrixXi written_cells(const Eigen::MatrixXi& cells, int n) const;

 private:
  std::vector<int> behind(int n) const;
};

/// What joins nodes of the whole mesh besides its tetrahedra. Who owns one of them has all that is at the others, too.
struct Joined {
  bool triangles;          ///< nodes of each boundary triangle
  bool surface;            ///< all nodes of the boundary, in all shares
  Eigen::Matrix2Xi pairs;  ///< of nodes
};

/// Shares of a mesh that the first process has, by recursive bisection of its nodes.
Share deal_out(TetMesh whole, int degree, const Joined& joined);

}  // namespace testbed::fem
