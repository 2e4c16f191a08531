// Nodes and deal.II spaces on straight tetrahedra. Internal to the library: it brings deal.II's headers.
#pragma once

#include <deal.II/dofs/dof_handler.h>
#include <deal.II/fe/fe_simplex_p.h>
#include <deal.II/fe/fe_system.h>
#include <deal.II/fe/mapping_fe.h>
#include <deal.II/grid/filtered_iterator.h>
#include <deal.II/grid/tria.h>

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <array>
#include <map>
#include <unordered_map>
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

/// Its cells are divided among the processes by their subdomain.
dealii::Triangulation<3>& triangulate(const TetMesh& mesh, dealii::Triangulation<3>& triangulation);

/// A vector-valued Lagrange space, its degrees of freedom
/// by node and back. Those of a node follow each other.
struct Space {
  dealii::FE_SimplexP<3> scalar_element;
  dealii::FESystem<3> element;
  dealii::DoFHandler<3> dofs;
  std::vector<unsigned> dof_of;  ///< of component c of node i: dof_of[3 i + c]
  std::vector<int> flat_of;      ///< the inverse: 3 i + c of a degree of freedom

  Space(const dealii::Triangulation<3>& triangulation, int degree, const Nodes& nodes);

  using Cell = dealii::DoFHandler<3>::active_cell_iterator;
  /// This process' cells.
  auto cells() const {
    return dealii::filter_iterators(
        dofs.active_cell_iterators(),
        dealii::IteratorFilters::SubdomainEqualTo(static_cast<unsigned>(processes().rank)));
  }
  /// First degree of freedom over 3 of the node of each of a cell's scalar functions.
  std::vector<int> ranks(const Cell& cell) const;
};

/// The symmetric matrix of a space: its lower half, diagonal included, and what its degrees of freedom are
/// held at. Rows and columns of held ones are empty but for the diagonal.
class SystemMatrix {
 public:
  using Rows = Eigen::SparseMatrix<double, Eigen::RowMajor>;

  Rows lower;
  std::vector<char> is_held;   ///< by degree of freedom
  Eigen::VectorXd prescribed;  ///< value of the held ones (m)

  /// Nothing held.
  explicit SystemMatrix(const Space& space);
  /// Zero, with room for what this process' cells couple.
  void reset(const Space& space);
  /// Adds a cell's matrix, whose 3 x 3 blocks (a, b), a <= b, are given, and force (3 x n); `ranks` of its n
  /// nodes: first degree of freedom over 3.
  template <class Matrix, class Force>
  void add_cell(const std::vector<int>& ranks, const Matrix& K, const Force& f, Eigen::VectorXd& force);

 private:
  void add_block(int row, int column, const Eigen::Matrix3d& block);
};

template <class Matrix, class Force>
void SystemMatrix::add_cell(const std::vector<int>& ranks, const Matrix& K, const Force& f,
                            Eigen::VectorXd& force) {
  const int n = static_cast<int>(ranks.size());
  for (int a = 0; a < n; ++a) force.segment<3>(3 * ranks[a]) += f.col(a);
  for (int b = 0; b < n; ++b)
    for (int a = 0; a <= b; ++a) {
      Eigen::Matrix3d block = K.template block<3, 3>(3 * a, 3 * b);
      for (int j = 0; j < 3; ++j) {
        const int in_a = 3 * ranks[a] + j, in_b = 3 * ranks[b] + j;
        if (is_held[in_b]) {
          force.segment<3>(3 * ranks[a]) -= block.col(j) * prescribed(in_b);
          const double diagonal = block(j, j);
          block.col(j).setZero();
          if (a == b) block(j, j) = diagonal;
        }
        if (a != b && is_held[in_a]) {
          force.segment<3>(3 * ranks[b]) -= block.row(j).transpose() * prescribed(in_a);
          block.row(j).setZero();
        }
      }
      if (a == b)
        for (int j = 0; j < 3; ++j)
          for (int i = 0; i < 3; ++i)
            if (i != j && is_held[3 * ranks[a] + i]) block(i, j) = 0;
      if (ranks[a] >= ranks[b])
        add_block(ranks[a], ranks[b], block);
      else
        add_block(ranks[b], ranks[a], block.transpose());
    }
}

}  // namespace testbed::fem
