// Nodes and deal.II spaces on straight tetrahedra. Internal to the library: it brings deal.II's headers.
#pragma once

#include <deal.II/dofs/dof_handler.h>
#include <deal.II/fe/fe_simplex_p.h>
#include <deal.II/fe/fe_system.h>
#include <deal.II/fe/mapping_fe.h>
#include <deal.II/grid/filtered_iterator.h>
#include <deal.II/grid/tria.h>

#include <vector>

#include "fem_reference/elements/share.h"

namespace testbed::fem {

/// Tetrahedra from number n_own on are not of the subdomain that this process counts.
dealii::Triangulation<3>& triangulate(const TetMesh& mesh, int n_own,
                                      dealii::Triangulation<3>& triangulation);

/// A vector-valued Lagrange space, its degrees of freedom
/// by node and back. Those of a node follow each other.
struct Space {
  dealii::FE_SimplexP<3> scalar_element;
  dealii::FESystem<3> element;
  dealii::DoFHandler<3> dofs;
  std::vector<unsigned> dof_of;  ///< of component c of node i: dof_of[3 i + c]
  std::vector<int> flat_of;      ///< the inverse: 3 i + c of a degree of freedom

  Space(const dealii::Triangulation<3>& triangulation, int degree, const Nodes& nodes);

  /// Those that this process counts.
  auto cells() const {
    return dealii::filter_iterators(
        dofs.active_cell_iterators(),
        dealii::IteratorFilters::SubdomainEqualTo(static_cast<unsigned>(processes().rank)));
  }
};

}  // namespace testbed::fem
