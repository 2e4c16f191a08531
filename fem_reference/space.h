// Nodes and deal.II spaces on straight tetrahedra. Internal to the library: it brings deal.II's headers.
#pragma once

#include <deal.II/dofs/dof_handler.h>
#include <deal.II/fe/fe_simplex_p.h>
#include <deal.II/fe/fe_system.h>
#include <deal.II/fe/mapping_fe.h>
#include <deal.II/grid/tria.h>
#include <deal.II/lac/affine_constraints.h>
#include <deal.II/lac/sparse_matrix.h>
#include <deal.II/lac/vector.h>

#include <Eigen/Core>
#include <array>
#include <map>
#include <unordered_map>
#include <vector>

#include "meshing/mesh.h"

namespace testbed {

using DealVector = dealii::Vector<double>;

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

dealii::Triangulation<3>& triangulate(const TetMesh& mesh, dealii::Triangulation<3>& triangulation);

/// A vector-valued Lagrange space, its degrees of freedom by node and back.
struct Space {
  dealii::FE_SimplexP<3> scalar_element;
  dealii::FESystem<3> element;
  dealii::DoFHandler<3> dofs;
  std::vector<unsigned> dof_of;  ///< of component c of node i: dof_of[3 i + c]
  std::vector<int> flat_of;      ///< the inverse: 3 i + c of a degree of freedom

  Space(const dealii::Triangulation<3>& triangulation, int degree, const Nodes& nodes);
};

/// The matrix of a space; rows of held degrees of freedom are replaced by their diagonal.
struct SystemMatrix {
  dealii::AffineConstraints<double> constraints;
  dealii::SparsityPattern pattern;
  dealii::SparseMatrix<double> matrix;

  void allocate(const Space& space);
};

}  // namespace testbed
