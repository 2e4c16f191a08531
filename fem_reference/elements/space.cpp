#include "fem_reference/elements/space.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <sstream>
#include <stdexcept>

namespace testbed::fem {
dealii::Triangulation<3>& triangulate(const TetMesh& mesh, int n_own,
                                      dealii::Triangulation<3>& triangulation) {
  std::vector<dealii::Point<3>> vertices;
  for (int i = 0; i < mesh.X.cols(); ++i) vertices.emplace_back(mesh.X(0, i), mesh.X(1, i), mesh.X(2, i));
  std::vector<dealii::CellData<3>> tetrahedra;
  for (int t = 0; t < mesh.T.cols(); ++t) {
    const Eigen::Vector3d a = mesh.X.col(mesh.T(0, t));
    const double volume =
        (mesh.X.col(mesh.T(1, t)) - a).cross(mesh.X.col(mesh.T(2, t)) - a).dot(mesh.X.col(mesh.T(3, t)) - a) /
        6;
    if (!(volume > 0)) {  // deal.II would solve on it and say nothing
      std::ostringstream what;
      what << "tetrahedron " << t << " of nodes " << mesh.T.col(t).transpose() << ": volume " << volume
           << " m3, expected > 0";
      throw std::runtime_error(what.str());
    }
    dealii::CellData<3> cell(4);
    for (int k = 0; k < 4; ++k) cell.vertices[k] = static_cast<unsigned>(mesh.T(k, t));
    tetrahedra.push_back(cell);
  }
  triangulation.create_triangulation(vertices, tetrahedra, dealii::SubCellData());
  const auto [n, rank, n_threads, n_here] = processes();
  for (const auto& cell : triangulation.active_cell_iterators())
    cell->set_subdomain_id(
        static_cast<unsigned>(static_cast<int>(cell->active_cell_index()) < n_own ? rank : n));
  return triangulation;
}

Space::Space(const dealii::Triangulation<3>& triangulation, int degree, const Nodes& nodes)
    : scalar_element(degree), element(scalar_element, 3), dofs(triangulation) {
  dofs.distribute_dofs(element);
  dof_of.resize(dofs.n_dofs());
  flat_of.resize(dofs.n_dofs());
  for (const auto& cell : dofs.active_cell_iterators()) {
    for (unsigned v = 0; v < 4; ++v)
      for (unsigned c = 0; c < 3; ++c) dof_of[3 * cell->vertex_index(v) + c] = cell->vertex_dof_index(v, c);
    if (degree == 2)
      for (unsigned l = 0; l < 6; ++l) {
        const auto line = cell->line(l);
        const int node =
            nodes.middle(static_cast<int>(line->vertex_index(0)), static_cast<int>(line->vertex_index(1)));
        for (unsigned c = 0; c < 3; ++c) dof_of[3 * node + c] = line->dof_index(c);
      }
  }
  for (unsigned k = 0; k < dof_of.size(); ++k) flat_of[dof_of[k]] = static_cast<int>(k);
  for (unsigned k = 0; k < dof_of.size(); k += 3)
    if (dof_of[k] % 3 != 0 || dof_of[k + 1] != dof_of[k] + 1 || dof_of[k + 2] != dof_of[k] + 2)
      throw std::logic_error("deal.II: degrees of freedom of a node are expected side by side");
}

}  // namespace testbed::fem
