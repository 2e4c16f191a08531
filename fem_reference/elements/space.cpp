#include "fem_reference/elements/space.h"

#include <deal.II/grid/grid_tools.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <sstream>
#include <stdexcept>

namespace testbed::fem {
namespace {

/// Corners of the edges of a tetrahedron, in the order of VTK's quadratic one.
constexpr int kTetEdges[6][2] = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};

}  // namespace

Nodes::Nodes(const TetMesh& mesh, int degree) : n_vertices(static_cast<int>(mesh.X.cols())) {
  cells.resize(degree == 1 ? 4 : 10, mesh.T.cols());
  cells.topRows(4) = mesh.T;
  faces.resize(degree == 1 ? 3 : 6, mesh.F.cols());
  faces.topRows(3) = mesh.F;
  X = mesh.X;
  if (degree == 1) return;
  std::vector<std::array<int, 2>> ends;
  for (int t = 0; t < mesh.T.cols(); ++t)
    for (int e = 0; e < 6; ++e) {
      const int a = mesh.T(kTetEdges[e][0], t), b = mesh.T(kTetEdges[e][1], t);
      const auto [at, is_new] = middle_.try_emplace(key(a, b), n_vertices + static_cast<int>(ends.size()));
      if (is_new) ends.push_back({{a, b}});
      cells(4 + e, t) = at->second;
    }
  for (int f = 0; f < mesh.F.cols(); ++f)
    for (int e = 0; e < 3; ++e) faces(3 + e, f) = middle(mesh.F(e, f), mesh.F((e + 1) % 3, f));
  edges = Eigen::Map<const Eigen::Matrix2Xi>(ends.data()->data(), 2, static_cast<Eigen::Index>(ends.size()));
  X.conservativeResize(3, n_vertices + edges.cols());
  for (int e = 0; e < edges.cols(); ++e)
    X.col(n_vertices + e) = (X.col(edges(0, e)) + X.col(edges(1, e))) / 2;
}

dealii::Triangulation<3>& triangulate(const TetMesh& mesh, dealii::Triangulation<3>& triangulation) {
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
  if (const int n = processes().n; n > 1)
    dealii::GridTools::partition_triangulation(static_cast<unsigned>(n), triangulation);
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
