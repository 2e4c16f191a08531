// Nodes and deal.II spaces on straight tetrahedra. Internal to the library: it brings deal.II's headers.
#pragma once

#include <deal.II/dofs/dof_handler.h>
#include <deal.II/fe/fe_simplex_p.h>
#include <deal.II/fe/fe_system.h>
#include <deal.II/fe/mapping_fe.h>
#include <deal.II/grid/filtered_iterator.h>
#include <deal.II/grid/tria.h>

#include <Eigen/Core>
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

  /// This process' cells.
  auto cells() const {
    return dealii::filter_iterators(
        dofs.active_cell_iterators(),
        dealii::IteratorFilters::SubdomainEqualTo(static_cast<unsigned>(processes().rank)));
  }
};

}  // namespace testbed::fem
