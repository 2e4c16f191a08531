// The loops over cells: loads, forces, stiffness, mass and energy.
#include <deal.II/base/quadrature_lib.h>
#include <deal.II/fe/fe_values.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "fem_reference/solid/implementation.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using meshing::Curvature;
using meshing::SurfaceHessian;

Vector3d eigen(const dealii::Point<3>& p) {
  return {p[0], p[1], p[2]};
}

/// Largest |principal strain|, or at finite strain |principal stretch - 1|; that of another point where this
/// one's is smaller, which the norm of its strain often tells without its eigenvalues.
double largest_strain(ElasticLaw law, const Eigen::Matrix3d& H, double of_others) {
  using Solver = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>;
  if (law == ElasticLaw::SmallStrain) {
    const Eigen::Matrix3d strain = (H + H.transpose()) / 2;
    if (strain.norm() <= of_others) return of_others;
    return std::max(of_others, Solver(strain, Eigen::EigenvaluesOnly).eigenvalues().cwiseAbs().maxCoeff());
  }
  const Eigen::Matrix3d C_1 = H + H.transpose() + H.transpose() * H;  // C - I
  const double bound = C_1.norm();
  if (bound < 1 && 1 - std::sqrt(1 - bound) <= of_others) return of_others;
  const Eigen::Array3d squares_1 = Solver(C_1, Eigen::EigenvaluesOnly).eigenvalues().array().max(-1);
  return std::max(of_others, (squares_1 / (1 + (1 + squares_1).sqrt())).abs().maxCoeff());
}

/// Barycentric coordinates of a tetrahedron's nodes.
Eigen::Matrix4Xd nodes_of_tet(int degree) {
  Eigen::Matrix4Xd points(4, degree == 1 ? 4 : 10);
  points.leftCols<4>().setIdentity();
  if (degree == 2)
    for (int i = 0, a = 4; i < 4; ++i)
      for (int k = i + 1; k < 4; ++k, ++a) points.col(a) = (points.col(i) + points.col(k)) / 2;
  return points;
}

}  // namespace

ElasticSolid::Implementation::Implementation(Share part, int p)
    : share(std::move(part)),
      degree(p),
      nodes(mesh, degree),
      space(triangulate(mesh, share.n_own, triangulation), degree, nodes),
      tets(nodes.X, nodes.cells, share.n_own, share.is_ghost),
      corners(degree == 2 ? std::make_optional<TetBatches>(mesh.X, mesh.T, share.n_own, share.is_ghost)
                          : std::nullopt),
      solver(share, nodes.X, nodes.edges, tets, corners ? &*corners : nullptr),
      from_corners(nodes.X.cols(), nodes.n_vertices),
      u(Matrix3Xd::Zero(3, nodes.X.cols())) {
  std::vector<Eigen::Triplet<double>> weights;
  for (int i = 0; i < nodes.n_vertices; ++i) weights.emplace_back(i, i, 1.);
  for (int e = 0; e < nodes.edges.cols(); ++e)
    for (const int end : nodes.edges.col(e)) weights.emplace_back(nodes.n_vertices + e, end, 0.5);
  from_corners.setFromTriplets(weights.begin(), weights.end());
}

/// Exact for the stiffness of degree p at small strain and no eigenstrain that varies.
TetRule ElasticSolid::Implementation::rule(int p) const {
  const int order = p + (loads.shrinkage ? 1 : 0);
  TetRule rule;
  if (order == 2) {
    // The symmetric rule of degree 2; deal.II's own has six points, with results that depend on node numbers.
    const double b = (5 - std::sqrt(5)) / 20;
    rule.points = Eigen::Matrix4d::Constant(b);
    rule.points.diagonal().setConstant(1 - 3 * b);
    rule.weights = Eigen::Vector4d::Constant(0.25);
    return rule;
  }
  const dealii::QGaussSimplex<3> points(static_cast<unsigned>(order));
  rule.points.resize(4, points.size());
  rule.weights.resize(points.size());
  for (unsigned q = 0; q < points.size(); ++q) {
    const Vector3d x = eigen(points.point(q));
    rule.points.col(q) << 1 - x.sum(), x;
    rule.weights(q) = 6 * points.weight(q);
  }
  return rule;
}

void ElasticSolid::Implementation::shrink(double load_factor) {
  if (!loads.shrinkage || load_factor == shrunk_at) return;
  shrunk_at = load_factor;
  for (TetBatches* on : {&tets, corners ? &*corners : nullptr})
    if (on) on->set_shrinkage([&](const Vector3d& x) { return loads.shrinkage(x, load_factor); });
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
    triangle_of[corners] = share.is_whole ? f : share.face[f];
  }
  for (const auto& cell : space.dofs.active_cell_iterators()) {
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
      const auto triangle = triangle_of.find(corners);
      if (triangle == triangle_of.end()) continue;  // to tetrahedra of other processes
      face_values.reinit(cell, f);
      for (unsigned q = 0; q < on_face.size(); ++q)
        add(face_values, q, loads.traction(eigen(face_values.quadrature_point(q)), triangle->second));
    }
  }
  Matrix3Xd owned = load.reshaped(3, nodes.X.cols());
  share.clear_ghosts(owned);
  load = owned.reshaped();
}

void ElasticSolid::Implementation::find_residual(const Matrix3Xd& at, double load_factor, Matrix3Xd& r) {
  shrink(load_factor);
  tets.forces(at, r);
  size = std::max(size, load_factor * share.norm(load.reshaped(3, r.cols())) + share.norm(r));
  r = load_factor * load.reshaped(3, r.cols()) - r;
  for (const auto& energy : surface_at(load_factor)) energy->add_forces(nodes.X + at, r);
  share.clear_ghosts(r);
  for (Eigen::Index k = 0; k < r.size(); ++k)
    if (is_constrained[k]) r.data()[k] = 0;
}

double ElasticSolid::Implementation::potential(const Matrix3Xd& at, double load_factor) {
  return sum_over_processes(energy(at, load_factor) - load_factor * load.dot(at.reshaped()));
}

double ElasticSolid::Implementation::energy(const Matrix3Xd& at, double load_factor) {
  shrink(load_factor);
  double sum = tets.energy(at);
  for (const auto& acting : surface_at(load_factor)) sum += acting->energy(nodes.X + at);
  return sum;
}

const meshing::SurfaceEnergies& ElasticSolid::Implementation::surface_at(double load_factor) const {
  for (const auto& energy : surface) energy->set_load_factor(load_factor);
  return surface;
}

template <class Real>
SurfaceHessian ElasticSolid::Implementation::fill(const TetBatches& on, const Matrix3Xd& at,
                                                  double load_factor, Curvature curvature,
                                                  Real* blocks) const {
  on.add_tangent(at, blocks);
  SurfaceHessian H, outside;
  for (const auto& energy : surface_at(load_factor)) energy->add_hessian(nodes.X + at, H, curvature);
  if (&on != &tets) H = at_nodes(H, from_corners);
  const int n_own = on.first_row().back();
  H.for_each_block([&](int i, int j, const Eigen::Matrix3d& block) {
    const int row = on.rank()[i], column = on.rank()[j], place = on.pattern().find_any(row, column);
    if (place >= 0)
      Eigen::Map<Eigen::Matrix<Real, 3, 3>>(blocks + 9 * static_cast<std::ptrdiff_t>(place)) +=
          block.cast<Real>();
    else if (std::min(row, column) < n_own)
      outside.blocks.push_back({row, column, block});
  });
  for (const Matrix3Xd& g : H.roots) {
    Matrix3Xd& by_rank = outside.roots.emplace_back(Matrix3Xd::Zero(3, on.pattern().rows()));
    for (Eigen::Index i = 0; i < g.cols(); ++i)
      if (on.rank()[i] < n_own) by_rank.col(on.rank()[i]) = g.col(i);
  }
  symmetrise(on.pattern(), blocks);
  return outside;
}

template SurfaceHessian ElasticSolid::Implementation::fill(const TetBatches& on, const Matrix3Xd& at,
                                                           double load_factor, Curvature curvature,
                                                           double* blocks) const;

namespace {

TwoLevelSolver::Outside padded(SurfaceHessian outside) {
  TwoLevelSolver::Outside result{std::move(outside.blocks), {}};
  for (const Matrix3Xd& g : outside.roots) pad(g, 1, result.roots.emplace_back());
  return result;
}

/// Of constrained unknowns nothing is left.
void hold_blocks(const std::vector<char>& is_constrained_row, std::vector<meshing::SymmetricBlock>& outside) {
  for (meshing::SymmetricBlock& b : outside)
    for (int c = 0; c < 3; ++c) {
      if (is_constrained_row[3 * b.i + c]) b.block.row(c).setZero();
      if (is_constrained_row[3 * b.j + c]) b.block.col(c).setZero();
    }
}

void hold_outside(const std::vector<char>& is_constrained_row, TwoLevelSolver::Outside& outside) {
  hold_blocks(is_constrained_row, outside.blocks);
  for (meshing::PaddedField& g : outside.roots)
    for (size_t k = 0; k < is_constrained_row.size(); ++k)
      if (is_constrained_row[k]) g(static_cast<Eigen::Index>(k % 3), static_cast<Eigen::Index>(k / 3)) = 0;
}

}  // namespace

void ElasticSolid::Implementation::hold(TwoLevelSolver::Stiffness& A) const {
  meshing::hold(tets.pattern(), constrained_rows, A.blocks.data());
  hold_outside(constrained_rows, A.outside);
}

TwoLevelSolver::Stiffness ElasticSolid::Implementation::stiffness_at(const Matrix3Xd& at, double load_factor,
                                                                     Curvature curvature) const {
  TwoLevelSolver::Stiffness A;
  A.blocks.assign(9 * tets.pattern().column.size() + 3, 0);
  A.outside = padded(fill(tets, at, load_factor, curvature, A.blocks.data()));
  const auto fill_constrained = [=](const TetBatches& on, const std::vector<char>& is_constrained_row) {
    return [=, &on, &is_constrained_row](meshing::BlockMatrix& B) {
      double* blocks = B.block.data()->data();
      SurfaceHessian rest = fill(on, at, load_factor, curvature, blocks);
      meshing::hold(B, is_constrained_row, blocks);
      hold_blocks(is_constrained_row, rest.blocks);
      return rest.blocks;
    };
  };
  A.fill_fine = fill_constrained(tets, constrained_rows);
  if (corners) A.fill_corners = fill_constrained(*corners, constrained_corner_rows);
  return A;
}

namespace {

/// Adds masses, the same of three unknowns of a node, to blocks of a pattern.
template <class Real>
void add_masses(const Eigen::SparseMatrix<double>& of_nodes, double factor, const TetBatches& on,
                Real* blocks) {
  for (int j = 0; j < of_nodes.outerSize(); ++j)
    for (Eigen::SparseMatrix<double>::InnerIterator entry(of_nodes, j); entry; ++entry) {
      const int place = on.pattern().find(on.rank()[entry.row()], on.rank()[j]);
      Eigen::Map<Eigen::Matrix<Real, 3, 3>>(blocks + 9 * static_cast<std::ptrdiff_t>(place))
          .diagonal()
          .array() += static_cast<Real>(factor * entry.value());
    }
}

/// Consistent, of linear functions on tetrahedra of one density.
Eigen::SparseMatrix<double> mass_of_corners(const TetMesh& mesh, double density) {
  std::vector<Eigen::Triplet<double>> entries;
  for (const auto& t : mesh.T.colwise()) {
    const Eigen::Matrix3d edges = mesh.X(Eigen::all, t.tail<3>()).colwise() - mesh.X.col(t(0));
    const double mass = density * edges.determinant() / 6;
    for (const int i : t)
      for (const int j : t) entries.emplace_back(i, j, mass / (i == j ? 10 : 20));
  }
  Eigen::SparseMatrix<double> M(mesh.X.cols(), mesh.X.cols());
  M.setFromTriplets(entries.begin(), entries.end());
  return M;
}

/// Of nodes, each with three unknowns of that mass.
Eigen::SparseMatrix<double> mass_of_nodes(const Eigen::SparseMatrix<double>& M) {
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < M.outerSize(); j += 3)
    for (Eigen::SparseMatrix<double>::InnerIterator entry(M, j); entry; ++entry)
      entries.emplace_back(static_cast<int>(entry.row()) / 3, j / 3, entry.value());
  Eigen::SparseMatrix<double> of_nodes(M.rows() / 3, M.cols() / 3);
  of_nodes.setFromTriplets(entries.begin(), entries.end());
  return of_nodes;
}

}  // namespace

StepSolver ElasticSolid::step_solver(const Eigen::SparseMatrix<double>& M, double mass,
                                     const Matrix3Xd& displacement, double stiffness,
                                     const std::vector<int>& constrained) const {
  const Implementation& s = *self_;
  struct System {
    Eigen::SparseMatrix<double> fine, corners;  // masses of nodes
    std::vector<char> rows, corner_rows;        // constrained
    TwoLevelSolver::Stiffness A;
    TwoLevelSolver solver;
  };
  const TetBatches* corners = s.corners ? &*s.corners : nullptr;
  const auto system = std::make_shared<System>(
      System{mass_of_nodes(M), {}, {}, {}, {}, {s.share, s.nodes.X, s.nodes.edges, s.tets, corners}});
  std::vector<char> is_constrained(s.nodes.X.size());
  for (const int k : constrained) is_constrained[k] = true;
  system->rows = rows_of(s.tets, is_constrained);
  if (corners) {
    system->corners = mass_of_corners(s.mesh, s.material.rho);
    system->corner_rows = rows_of(*corners, is_constrained);
  }
  const auto fill = [&s, mass, stiffness, displacement](const TetBatches& on,
                                                        const Eigen::SparseMatrix<double>& masses,
                                                        const std::vector<char>& rows, auto* blocks) {
    using Real = std::remove_pointer_t<decltype(blocks)>;
    SurfaceHessian outside = s.fill(on, displacement, 1, Curvature::Exact, blocks);
    outside.scale(stiffness);
    Eigen::Map<Eigen::VectorX<Real>>(blocks, static_cast<Eigen::Index>(9 * on.pattern().column.size())) *=
        static_cast<Real>(stiffness);
    add_masses(masses, mass, on, blocks);
    meshing::hold(on.pattern(), rows, blocks);
    return outside;
  };
  const auto fill_double = [fill](const TetBatches& on, const Eigen::SparseMatrix<double>& masses,
                                  const std::vector<char>& rows) {
    return [=, &on, &masses, &rows](meshing::BlockMatrix& B) {
      SurfaceHessian outside = fill(on, masses, rows, B.block.data()->data());
      hold_blocks(rows, outside.blocks);
      return outside.blocks;
    };
  };
  system->A.blocks.assign(9 * s.tets.pattern().column.size() + 3, 0);
  system->A.outside = padded(fill(s.tets, system->fine, system->rows, system->A.blocks.data()));
  if (mass == 0) system->A.outside.roots.clear();  // as natural modes leave them out
  hold_outside(system->rows, system->A.outside);
  system->A.fill_fine = fill_double(s.tets, system->fine, system->rows);
  if (corners) system->A.fill_corners = fill_double(*corners, system->corners, system->corner_rows);
  system->solver.hold(is_constrained);
  const Eigen::MatrixXd rigid = mass == 0 ? rigid_motions_at_rest() : Eigen::MatrixXd(s.nodes.X.size(), 0);
  return [system, rigid](const Eigen::VectorXd& r, double tolerance) -> std::optional<Eigen::VectorXd> {
    Matrix3Xd x = Matrix3Xd::Zero(3, r.size() / 3);
    const LinearReport found = system->solver.solve(system->A, rigid, r.reshaped(3, x.cols()), tolerance, x);
    if (!found.is_definite || found.residual > 1) return {};
    return x.reshaped();
  };
}

/// Makes u orthogonal to the free rigid motions in L2 over the volume, whatever the mesh.
void ElasticSolid::Implementation::remove_rigid_motion(Matrix3Xd& displacement) const {
  const auto m = rigid.cols();
  if (m == 0) return;
  Eigen::MatrixXd fields(rigid.rows(), m + 1);  // motions and displacement, over 3 i + c
  fields << rigid, displacement.reshaped();
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

double ElasticSolid::Implementation::max_strain(const Matrix3Xd& at) const {
  double largest = 0;
  tets.for_each_gradient(at, tets.rule().points,
                         [&](const Eigen::Matrix3d& H) { largest = largest_strain(law, H, largest); });
  return largest_over_processes(largest);
}

double ElasticSolid::Implementation::least_jacobian(const Matrix3Xd& at,
                                                    const Eigen::Matrix4Xd& points) const {
  double least = std::numeric_limits<double>::infinity();
  tets.for_each_gradient(at, points, [&](const Eigen::Matrix3d& H) {
    least = std::min(least, (Eigen::Matrix3d::Identity() + H).determinant());
  });
  return -largest_over_processes(-least);
}

SmallestJacobians ElasticSolid::smallest_jacobians(const Matrix3Xd& displacement) const {
  const Implementation& s = *self_;
  return {s.least_jacobian(displacement, s.tets.rule().points),
          s.least_jacobian(displacement, nodes_of_tet(s.degree))};
}

double ElasticSolid::energy(const Eigen::Ref<const Matrix3Xd>& displacement, double load_factor) const {
  return self_->energy(displacement, load_factor);
}

void ElasticSolid::find_forces(const Eigen::Ref<const Matrix3Xd>& displacement, double load_factor,
                               Matrix3Xd& force) const {
  Implementation& s = *self_;
  s.shrink(load_factor);
  s.tets.forces(displacement, force);
  if (!s.surface.empty()) {
    Matrix3Xd by_surface = Matrix3Xd::Zero(3, force.cols());
    for (const auto& energy : s.surface_at(load_factor))
      energy->add_forces(s.nodes.X + displacement, by_surface);
    force -= by_surface;
  }
  s.share.clear_ghosts(force);
}

Linearisation ElasticSolid::linearise(const Matrix3Xd& displacement, double load_factor,
                                      bool with_tangent) const {
  const Implementation& s = *self_;
  Linearisation result;
  Matrix3Xd force;
  find_forces(displacement, load_factor, force);
  result.energy = s.tets.energy(displacement);
  result.force = force.reshaped();
  if (with_tangent) {
    s.find_tangent(displacement, load_factor, Curvature::Exact, result);
    s.drop_ghosts(result.tangent);
  }
  return result;
}

void ElasticSolid::Implementation::find_tangent(const Matrix3Xd& at, double load_factor, Curvature curvature,
                                                Linearisation& result) const {
  meshing::BlockMatrix K = tets.pattern();
  K.block.assign(K.column.size(), Eigen::Matrix3d::Zero());
  const SurfaceHessian outside = fill(tets, at, load_factor, curvature, K.block.data()->data());
  if (!outside.blocks.empty()) K = with_blocks(K, outside.blocks);
  std::vector<int> node(K.rows());
  for (int i = 0; i < K.rows(); ++i) node[tets.rank()[i]] = i;
  // Columns of the symmetric matrix are its rows; those of a node are compressed in the nodes' order.
  result.tangent.resize(at.size(), at.size());
  result.tangent.reserve(static_cast<Eigen::Index>(9 * K.block.size()));
  std::vector<std::pair<int, int>> neighbours;  // node, block
  for (int i = 0; i < K.rows(); ++i) {
    const int row = tets.rank()[i];
    neighbours.clear();
    for (int k = K.row_start[row]; k < K.row_start[row + 1]; ++k)
      neighbours.emplace_back(node[K.column[k]], k);
    std::sort(neighbours.begin(), neighbours.end());
    for (int c = 0; c < 3; ++c) {
      result.tangent.startVec(3 * i + c);
      for (const auto& [j, k] : neighbours)
        for (int d = 0; d < 3; ++d) result.tangent.insertBack(3 * j + d, 3 * i + c) = K.block[k](c, d);
    }
  }
  result.tangent.finalize();
  for (const Matrix3Xd& g : outside.roots) {
    Eigen::VectorXd& by_node = result.roots.emplace_back(at.size());
    for (int i = 0; i < K.rows(); ++i) by_node.segment<3>(3 * i) = g.col(tets.rank()[i]);
  }
}

/// Rows that other processes own.
void ElasticSolid::Implementation::drop_ghosts(Eigen::SparseMatrix<double>& A) const {
  if (!share.is_whole)
    A.prune([&](Eigen::Index row, Eigen::Index, double) { return !share.is_ghost[row / 3]; });
}

Eigen::SparseMatrix<double> ElasticSolid::stiffness(Eigen::MatrixXd* roots) const {
  Linearisation at_rest;
  self_->shrink(0);
  meshing::SurfaceEnergies acting;  // contact has no finite stiffness where a body begins in touch
  for (const auto& energy : self_->surface)
    if (!energy->is_stiff()) acting.push_back(energy);
  std::swap(acting, self_->surface);
  self_->find_tangent(Matrix3Xd::Zero(3, X().cols()), 0, Curvature::Projected, at_rest);
  std::swap(acting, self_->surface);
  self_->drop_ghosts(at_rest.tangent);
  if (roots) {
    roots->resize(3 * X().cols(), static_cast<Eigen::Index>(at_rest.roots.size()));
    for (Eigen::Index k = 0; k < roots->cols(); ++k) roots->col(k) = at_rest.roots[k];
  }
  return at_rest.tangent;
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
    const auto nodes_of = self_->nodes.cells.col(static_cast<int>(cell->active_cell_index()));
    for (int a = 0; a < n; ++a)
      for (int b = 0; b < n; ++b)
        for (int c = 0; m(a, b) != 0 && c < 3; ++c)
          entries.emplace_back(3 * nodes_of(a) + c, 3 * nodes_of(b) + c, m(a, b));
  }
  Eigen::SparseMatrix<double> M(X().size(), X().size());
  M.setFromTriplets(entries.begin(), entries.end());
  self_->drop_ghosts(M);
  return M;
}

}  // namespace testbed::fem
