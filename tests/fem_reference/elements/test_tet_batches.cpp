// Batches of tetrahedra against deal.II's loop over cells with FEValues.
#include <deal.II/fe/fe_values.h>
#include <gtest/gtest.h>
#include <omp.h>

#include "fem_reference/elements/space.h"
#include "fem_reference/elements/tet_batches.h"
#include "tests/fem_reference/respond.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::Vector3d;

const LameConstants& lame() {
  static const LameConstants kConstants(Material{1000, 0.3, 1, 0});
  return kConstants;
}

/// The symmetric rule of degree 2, or a lopsided one of more points.
TetRule rule_of(int n_points) {
  TetRule rule;
  rule.points = Eigen::Matrix4Xd(4, n_points);
  for (int q = 0; q < n_points; ++q) {
    Eigen::Vector4d l(1 + q % 4 == 1, 1 + (q % 4 == 1), 1 + (q % 4 == 2), 1 + q % 3);
    rule.points.col(q) = l / l.sum();
  }
  rule.weights = Eigen::VectorXd::LinSpaced(n_points, 1, 2);
  rule.weights /= rule.weights.sum();
  return rule;
}

double shrinkage(const Vector3d& x) {
  return 0.1 / (1 + x.norm());
}

struct Assembled {
  double energy = 0;
  Eigen::VectorXd force;
  MatrixXd tangent;
};

/// By shape gradients of deal.II, over 3 node + component.
Assembled by_fe_values(const TetMesh& mesh, const Nodes& nodes, int degree, ElasticLaw law,
                       const TetRule& rule, bool is_shrunk, const Matrix3Xd& u) {
  dealii::Triangulation<3> triangulation;
  const Space space(triangulate(mesh, static_cast<int>(mesh.T.cols()), triangulation), degree, nodes);
  const dealii::MappingFE<3> mapping{dealii::FE_SimplexP<3>(1)};
  std::vector<dealii::Point<3>> points;
  std::vector<double> weights;
  for (int q = 0; q < rule.weights.size(); ++q) {
    points.emplace_back(rule.points(1, q), rule.points(2, q), rule.points(3, q));
    weights.push_back(rule.weights(q) / 6);
  }
  dealii::FEValues<3> values(
      mapping, space.element, dealii::Quadrature<3>(points, weights),
      dealii::update_gradients | dealii::update_JxW_values | dealii::update_quadrature_points);
  const auto n = static_cast<int>(space.element.n_dofs_per_cell());
  std::vector<unsigned> dofs(n);
  Assembled sum{0, Eigen::VectorXd::Zero(u.size()), MatrixXd::Zero(u.size(), u.size())};
  for (const auto& cell : space.dofs.active_cell_iterators()) {
    values.reinit(cell);
    cell->get_dof_indices(dofs);
    for (int q = 0; q < rule.weights.size(); ++q) {
      MatrixXd of_F = MatrixXd::Zero(9, n);  // derivative of F by each unknown
      Eigen::Matrix3d F = Eigen::Matrix3d::Identity();
      for (int i = 0; i < n; ++i) {
        const unsigned c = space.element.system_to_component_index(i).first;
        for (unsigned k = 0; k < 3; ++k) of_F(3 * k + c, i) = values.shape_grad_component(i, q, c)[k];
        F.reshaped() += u.reshaped()(space.flat_of[dofs[i]]) * of_F.col(i);
      }
      const dealii::Point<3> x = values.quadrature_point(q);
      const ElasticResponse r = respond(law, lame(), F, is_shrunk ? shrinkage({x[0], x[1], x[2]}) : 0);
      const double w = values.JxW(q);
      sum.energy += w * r.energy;
      const MatrixXd K = w * of_F.transpose() * r.C * of_F;
      for (int i = 0; i < n; ++i) {
        sum.force(space.flat_of[dofs[i]]) += w * of_F.col(i).dot(r.P.reshaped());
        for (int j = 0; j < n; ++j) sum.tangent(space.flat_of[dofs[i]], space.flat_of[dofs[j]]) += K(i, j);
      }
    }
  }
  return sum;
}

template <class Real>
MatrixXd dense_tangent(const TetBatches& tets, const Matrix3Xd& u) {
  const meshing::BlockMatrix& pattern = tets.pattern();
  std::vector<Real> blocks(9 * pattern.column.size());
  tets.add_tangent(u, blocks.data());
  symmetrise(pattern, blocks.data());
  MatrixXd K = MatrixXd::Zero(u.size(), u.size());
  std::vector<int> node(u.cols());
  for (int i = 0; i < u.cols(); ++i) node[tets.rank()[i]] = i;
  for (int i = 0; i < pattern.rows(); ++i)
    for (int k = pattern.row_start[i]; k < pattern.row_start[i + 1]; ++k)
      K.block<3, 3>(3 * node[i], 3 * node[pattern.column[k]]) =
          Eigen::Map<Eigen::Matrix<Real, 3, 3>>(&blocks[9 * static_cast<size_t>(k)]).template cast<double>();
  return K;
}

Matrix3Xd deformed(const Matrix3Xd& X) {
  Matrix3Xd u(3, X.cols());
  for (int i = 0; i < u.cols(); ++i) {
    const Vector3d x = X.col(i);
    u.col(i) = 0.1 * Vector3d(std::sin(2 * x(1) + x(2)), std::cos(x(0) - 2 * x(2)), std::sin(x(0) * x(1)));
  }
  return u;
}

class TetBatch : public testing::TestWithParam<std::tuple<ElasticLaw, int, int, bool>> {};
INSTANTIATE_TEST_SUITE_P(Laws, TetBatch,
                         testing::Combine(testing::Values(ElasticLaw::SmallStrain,
                                                          ElasticLaw::StVenantKirchhoff,
                                                          ElasticLaw::NeoHookean),
                                          testing::Values(1, 2), testing::Values(1, 4, 7), testing::Bool()));

TEST_P(TetBatch, IsWhatFEValuesAssemble) {
  constexpr double kDouble = 1e-13, kSingle = 1e-6;
  const auto [law, degree, n_points, is_shrunk] = GetParam();
  const TetMesh mesh = box_tets(3, 1, 1, 0.5, 0.1);  // tetrahedra that fill no whole number of batches
  ASSERT_NE(mesh.T.cols() % 8, 0);
  const Nodes nodes(mesh, degree);
  const TetRule rule = rule_of(n_points);
  TetBatches tets(nodes.X, nodes.cells);
  tets.set_law(law, lame(), rule);
  if (is_shrunk) tets.set_shrinkage(shrinkage);
  const Matrix3Xd u = deformed(nodes.X);
  const Assembled expected = by_fe_values(mesh, nodes, degree, law, rule, is_shrunk, u);
  EXPECT_GT(expected.energy, 1);
  EXPECT_NEAR(tets.energy(u), expected.energy, kDouble * expected.energy);
  Matrix3Xd f;
  tets.forces(u, f);
  EXPECT_LT((f.reshaped() - expected.force).norm(), kDouble * expected.force.norm());
  EXPECT_LT((dense_tangent<double>(tets, u) - expected.tangent).norm(), kDouble * expected.tangent.norm());
  EXPECT_LT((dense_tangent<float>(tets, u) - expected.tangent).norm(), kSingle * expected.tangent.norm());
}

TEST(TetBatches, HaveInfiniteEnergyWhereOneIsTurnedInsideOut) {
  const TetMesh mesh = box_tets(2, 1, 1, 0.5);
  const Nodes nodes(mesh, 2);
  TetBatches tets(nodes.X, nodes.cells);
  tets.set_law(ElasticLaw::NeoHookean, lame(), rule_of(4));
  Matrix3Xd u = Matrix3Xd::Zero(3, nodes.X.cols());
  EXPECT_EQ(tets.energy(u), 0);
  const int corner = mesh.T(0, mesh.T.cols() - 1);
  const Vector3d middle =
      (nodes.X.col(mesh.T(1, mesh.T.cols() - 1)) + nodes.X.col(mesh.T(2, mesh.T.cols() - 1)) +
       nodes.X.col(mesh.T(3, mesh.T.cols() - 1))) /
      3;
  u.col(corner) = 10 * (middle - nodes.X.col(corner));
  EXPECT_TRUE(std::isinf(tets.energy(u)));
}

TEST(TetBatches, CountTheEnergyOfTheFirstAlone) {
  const TetMesh mesh = box_tets(3, 2, 2, 0.3, 0.1);
  const Nodes nodes(mesh, 2);
  const auto n_own = static_cast<int>(nodes.cells.cols() / 3);
  TetBatches all(nodes.X, nodes.cells, n_own), first(nodes.X, nodes.cells.leftCols(n_own));
  for (TetBatches* tets : {&all, &first}) tets->set_law(ElasticLaw::NeoHookean, lame(), rule_of(4));
  const Matrix3Xd u = 0.1 * deformed(nodes.X);
  const double expected = first.energy(u);
  EXPECT_NEAR(all.energy(u), expected, 1e-13 * expected);
}

// Large enough to be subdivided.
TEST(TetBatches, GiveTheSameBitsOnOneThreadAndTwo) {
  const TetMesh mesh = box_tets(10, 9, 9, 0.1, 0.1);
  const Nodes nodes(mesh, 2);
  TetBatches tets(nodes.X, nodes.cells);
  ASSERT_TRUE(tets.is_subdivided());
  tets.set_law(ElasticLaw::NeoHookean, lame(), rule_of(4));
  const Matrix3Xd u = 0.1 * deformed(nodes.X);
  std::vector<float> blocks[2];
  double energy[2];
  Matrix3Xd f[2];
  for (const int n : {1, 2}) {
    omp_set_num_threads(n);
    blocks[n - 1].assign(9 * tets.pattern().column.size(), 0);
    tets.add_tangent(u, blocks[n - 1].data());
    energy[n - 1] = tets.energy(u);
    tets.forces(u, f[n - 1]);
  }
  EXPECT_EQ(energy[0], energy[1]);
  EXPECT_EQ(f[0], f[1]);
  EXPECT_EQ(blocks[0], blocks[1]);
}

}  // namespace
}  // namespace testbed::fem
