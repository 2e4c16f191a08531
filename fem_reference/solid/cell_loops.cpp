// The loops over cells: loads, forces, stiffness, mass and energy.
#include <deal.II/fe/fe_values.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

#include "fem_reference/elements/laws.h"
#include "fem_reference/solid/implementation.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

constexpr int kMaxNodes = 10;  // of a tetrahedron

Vector3d eigen(const dealii::Point<3>& p) {
  return {p[0], p[1], p[2]};
}
Vector3d eigen(const dealii::Tensor<1, 3>& p) {
  return {p[0], p[1], p[2]};
}

/// Largest |principal strain|, or at finite strain |principal stretch - 1|.
double largest_strain(ElasticLaw law, const Eigen::Matrix3d& F) {
  using Solver = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>;
  if (law == ElasticLaw::SmallStrain)
    return (Solver((F + F.transpose()) / 2, Eigen::EigenvaluesOnly).eigenvalues().array() - 1)
        .abs()
        .maxCoeff();
  return (Solver(F.transpose() * F, Eigen::EigenvaluesOnly).eigenvalues().array().max(0).sqrt() - 1)
      .abs()
      .maxCoeff();
}

}  // namespace

dealii::Quadrature<3> ElasticSolid::Implementation::quadrature(int p) const {
  const int order = p + (loads.shrinkage ? 1 : 0);
  if (order != 2) return dealii::QGaussSimplex<3>(static_cast<unsigned>(order));
  // The symmetric rule of degree 2; deal.II's own has six points, with results that depend on node numbers.
  const double b = (5 - std::sqrt(5)) / 20, a = 1 - 3 * b;
  return dealii::Quadrature<3>({{a, b, b}, {b, a, b}, {b, b, a}, {b, b, b}}, std::vector<double>(4, 1. / 24));
}

void ElasticSolid::Implementation::find_load() {
  load = Eigen::VectorXd::Zero(nodes.X.size());
  const auto p = static_cast<unsigned>(degree);
  const dealii::QWitherdenVincentSimplex<3> in_cell(p + 1);
  const dealii::QGaussSimplex<2> on_face(3);  // of degree 5: a cubic traction times quadratic functions
  const auto flags = dealii::update_values | dealii::update_JxW_values | dealii::update_quadrature_points;
  dealii::FEValues<3> values(mapping, space.element, in_cell, flags);
  dealii::FEFaceValues<3> face_values(mapping, space.element, on_face, flags);
  const unsigned n = space.element.n_dofs_per_cell();
  std::vector<unsigned> dofs(n);
  const auto add = [&](const auto& at, unsigned q, const Vector3d& density) {
    for (unsigned i = 0; i < n; ++i)
      load(space.flat_of[dofs[i]]) +=
          at.JxW(q) * density(space.element.system_to_component_index(i).first) * at.shape_value(i, q);
  };
  std::map<std::array<int, 3>, int> triangle_of;  // by sorted corners
  for (int f = 0; loads.traction && f < mesh.F.cols(); ++f) {
    std::array<int, 3> corners{{mesh.F(0, f), mesh.F(1, f), mesh.F(2, f)}};
    std::sort(corners.begin(), corners.end());
    triangle_of[corners] = f;
  }
  for (const auto& cell : space.cells()) {
    cell->get_dof_indices(dofs);
    if (loads.body_force) {
      values.reinit(cell);
      for (unsigned q = 0; q < in_cell.size(); ++q)
        add(values, q, loads.body_force(eigen(values.quadrature_point(q))));
    }
    for (unsigned f = 0; loads.traction && f < 4; ++f) {
      if (!cell->face(f)->at_boundary()) continue;
      std::array<int, 3> corners;
      for (unsigned k = 0; k < 3; ++k) corners[k] = static_cast<int>(cell->face(f)->vertex_index(k));
      std::sort(corners.begin(), corners.end());
      const int triangle = triangle_of.at(corners);
      face_values.reinit(cell, f);
      for (unsigned q = 0; q < on_face.size(); ++q)
        add(face_values, q, loads.traction(eigen(face_values.quadrature_point(q)), triangle));
    }
  }
  sum_over_processes(load);
}

template <class Use>
void ElasticSolid::Implementation::for_each_element(const Space& on, const Matrix3Xd& at, double load_factor,
                                                    const Tangent& tangent, Use use) const {
  const auto points = quadrature(static_cast<int>(on.element.degree));
  dealii::FEValues<3> values(
      mapping, on.scalar_element, points,
      dealii::update_gradients | dealii::update_JxW_values | dealii::update_quadrature_points);
  const LameConstants lame(material);
  const int n = static_cast<int>(on.scalar_element.n_dofs_per_cell());
  Eigen::Matrix<double, 3 * kMaxNodes, 3 * kMaxNodes> K;
  Eigen::Matrix<double, 3, kMaxNodes> f, g, u_cell;
  for (const auto& cell : on.cells()) {
    values.reinit(static_cast<dealii::Triangulation<3>::active_cell_iterator>(cell));
    const std::vector<int> ranks = on.ranks(cell);
    for (int a = 0; a < n; ++a) u_cell.col(a) = at.col(on.flat_of[3 * ranks[a]] / 3);
    K.setZero();
    f.setZero();
    double energy = 0;
    for (unsigned q = 0; q < points.size(); ++q) {
      const double w = values.JxW(q);
      for (int a = 0; a < n; ++a) g.col(a) = eigen(values.shape_grad(a, q));
      const Eigen::Matrix3d F = Eigen::Matrix3d::Identity() + u_cell.leftCols(n) * g.leftCols(n).transpose();
      const double s = loads.shrinkage ? loads.shrinkage(eigen(values.quadrature_point(q)), load_factor) : 0;
      const ElasticResponse r = respond(law, lame, F, s, tangent.of_body);
      energy += w * r.energy;
      f.leftCols(n).noalias() -= w * r.P * g.leftCols(n);
      for (int b = 0; tangent.of_body && b < n; ++b) {
        // Stress by a unit displacement of node b, a column for each component.
        const Eigen::Matrix<double, 9, 3> by_b =
            w * (r.C.leftCols<3>() * g(0, b) + r.C.middleCols<3>(3) * g(1, b) + r.C.rightCols<3>() * g(2, b));
        for (int a = 0; a <= b; ++a)
          K.block<3, 3>(3 * a, 3 * b) +=
              g(0, a) * by_b.topRows<3>() + g(1, a) * by_b.middleRows<3>(3) + g(2, a) * by_b.bottomRows<3>();
      }
    }
    use(ranks, K, f, energy);
  }
  for_each_follower(on.element.degree == 1 ? 3 : 6, at, load_factor,
                    [&](double p, const Eigen::VectorXi& face, const EnclosedVolume& v) {
                      std::vector<int> ranks;
                      for (int node : face) ranks.push_back(static_cast<int>(on.dof_of[3 * node] / 3));
                      use(ranks, ((tangent.of_pressure ? p : 0) * v.hessian).eval(), (-p * v.gradient).eval(),
                          0);
                    });
}

/// Tangent at `at`, whose columns are the nodes. Returns the
/// out-of-balance forces load - dW/du, less those of prescribed values.
Eigen::VectorXd ElasticSolid::Implementation::assemble_tangent(const Space& on, SystemMatrix& into,
                                                               const Matrix3Xd& at, double load_factor,
                                                               const Tangent& tangent) const {
  into.reset(on);
  Eigen::VectorXd force = Eigen::VectorXd::Zero(into.prescribed.size());
  for_each_element(on, at, load_factor, tangent,
                   [&](const std::vector<int>& ranks, const auto& K, const auto& f, double) {
                     into.add_cell(ranks, K, f, force);
                   });
  sum_over_processes(force);
  for (int i = 0; i < force.size(); ++i)
    force(i) = into.is_held[i] ? 0 : force(i) + load_factor * load(on.flat_of[i]);
  return force;
}

/// Makes u orthogonal to the free rigid motions in L2 over the volume, whatever the mesh.
void ElasticSolid::Implementation::remove_rigid_motion(Matrix3Xd& displacement) const {
  const auto m = rigid.cols();
  if (m == 0) return;
  Eigen::MatrixXd fields(rigid.rows(), m + 1);  // motions and displacement, over 3 i + c
  for (int k = 0; k < fields.rows(); ++k) fields.row(k) << rigid.row(space.dof_of[k]), displacement.data()[k];
  const dealii::QWitherdenVincentSimplex<3> points(2);  // exact for a product of degrees 2 and 1
  dealii::FEValues<3> values(mapping, space.element, points,
                             dealii::update_values | dealii::update_JxW_values);
  const unsigned n = space.element.n_dofs_per_cell();
  std::vector<unsigned> dofs(n);
  Eigen::MatrixXd products = Eigen::MatrixXd::Zero(m, m + 1), at(3, m + 1);
  for (const auto& cell : space.cells()) {
    values.reinit(cell);
    cell->get_dof_indices(dofs);
    for (unsigned q = 0; q < points.size(); ++q) {
      at.setZero();
      for (unsigned i = 0; i < n; ++i)
        at.row(space.element.system_to_component_index(i).first) +=
            values.shape_value(i, q) * fields.row(space.flat_of[dofs[i]]);
      products += values.JxW(q) * at.leftCols(m).transpose() * at;
    }
  }
  sum_over_processes(products.reshaped());
  displacement.reshaped() -= fields.leftCols(m) * products.leftCols(m).ldlt().solve(products.col(m));
}

void ElasticSolid::Implementation::measure(const Matrix3Xd& at, double load_factor, ElasticReport& report,
                                           bool with_strain) const {
  const auto points = quadrature(degree);
  dealii::FEValues<3> values(
      mapping, space.scalar_element, points,
      dealii::update_gradients | dealii::update_JxW_values | dealii::update_quadrature_points);
  const LameConstants lame(material);
  const unsigned n = space.element.n_dofs_per_cell();
  std::vector<unsigned> dofs(n);
  report.elastic_energy = report.max_strain = 0;
  for (const auto& cell : space.cells()) {
    values.reinit(static_cast<dealii::Triangulation<3>::active_cell_iterator>(cell));
    cell->get_dof_indices(dofs);
    for (unsigned q = 0; q < points.size(); ++q) {
      Eigen::Matrix3d F = Eigen::Matrix3d::Identity();
      for (unsigned i = 0; i < n; ++i) {
        const auto [c, a] = space.element.system_to_component_index(i);
        F.row(c) += at.data()[space.flat_of[dofs[i]]] * eigen(values.shape_grad(a, q)).transpose();
      }
      const double s = loads.shrinkage ? loads.shrinkage(eigen(values.quadrature_point(q)), load_factor) : 0;
      report.elastic_energy += values.JxW(q) * respond(law, lame, F, s, false).energy;
      if (with_strain) report.max_strain = std::max(report.max_strain, largest_strain(law, F));
    }
  }
  sum_over_processes(Eigen::Map<Eigen::VectorXd>(&report.elastic_energy, 1));
  report.max_strain = largest_over_processes(report.max_strain);
}

Linearisation ElasticSolid::linearise(const Matrix3Xd& displacement, double load_factor,
                                      bool with_tangent) const {
  const Space& space = self_->space;
  Linearisation result;
  SystemMatrix K(space);
  if (with_tangent) K.reset(space);
  Eigen::VectorXd force = Eigen::VectorXd::Zero(n_dofs());
  self_->for_each_element(
      space, displacement, load_factor, {with_tangent, with_tangent},
      [&](const std::vector<int>& ranks, const auto& cell_K, const auto& f, double energy) {
        result.energy += energy;
        if (with_tangent)
          K.add_cell(ranks, cell_K, f, force);
        else
          for (size_t a = 0; a < ranks.size(); ++a) force.segment<3>(3 * ranks[a]) += f.col(a);
      });
  result.force.resize(n_dofs());
  for (int i = 0; i < n_dofs(); ++i) result.force(space.flat_of[i]) = -force(i);
  if (!with_tangent) return result;
  std::vector<Eigen::Triplet<double>> entries;  // at 3 node + component
  entries.reserve(2 * K.lower.nonZeros());
  for (int i = 0; i < K.lower.rows(); ++i)
    for (SystemMatrix::Rows::InnerIterator entry(K.lower, i); entry; ++entry) {
      const int row = space.flat_of[i], column = space.flat_of[entry.col()];
      entries.emplace_back(row, column, entry.value());
      if (row != column) entries.emplace_back(column, row, entry.value());
    }
  result.tangent.resize(n_dofs(), n_dofs());
  result.tangent.setFromTriplets(entries.begin(), entries.end());
  return result;
}

Eigen::SparseMatrix<double> ElasticSolid::stiffness() const {
  return linearise(Matrix3Xd::Zero(3, X().cols()), 0).tangent;
}

Eigen::SparseMatrix<double> ElasticSolid::mass(MassMatrix kind) const {
  const Space& space = self_->space;
  const dealii::QWitherdenVincentSimplex<3> points(static_cast<unsigned>(self_->degree + 1));
  dealii::FEValues<3> values(self_->mapping, space.scalar_element, points,
                             dealii::update_values | dealii::update_JxW_values);
  std::vector<Eigen::Triplet<double>> entries;
  const auto n = static_cast<int>(space.scalar_element.n_dofs_per_cell());
  Eigen::MatrixXd m(n, n);
  Eigen::VectorXd N(n);
  for (const auto& cell : space.dofs.active_cell_iterators()) {
    values.reinit(static_cast<dealii::Triangulation<3>::active_cell_iterator>(cell));
    m.setZero();
    for (unsigned q = 0; q < points.size(); ++q) {
      for (int a = 0; a < n; ++a) N(a) = values.shape_value(a, q);
      m += self_->material.rho * values.JxW(q) * N * N.transpose();
    }
    // Row sums would be negative at the vertices of quadratic elements.
    if (kind == MassMatrix::Lumped)
      m = (m.sum() / m.trace() * m.diagonal()).asDiagonal().toDenseMatrix().eval();
    const std::vector<int> ranks = space.ranks(cell);
    for (int a = 0; a < n; ++a)
      for (int b = 0; b < n; ++b)
        for (int c = 0; m(a, b) != 0 && c < 3; ++c)
          entries.emplace_back(space.flat_of[3 * ranks[a] + c], space.flat_of[3 * ranks[b] + c], m(a, b));
  }
  Eigen::SparseMatrix<double> M(n_dofs(), n_dofs());
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

}  // namespace testbed::fem
