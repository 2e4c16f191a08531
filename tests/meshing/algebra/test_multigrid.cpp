#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>

#include "massspring/calibrations/calibrate.h"
#include "massspring/time/implicit_matrix.h"
#include "meshing/algebra/conjugate_gradients.h"
#include "meshing/algebra/multigrid.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kSingleRounding = 1e-5;

/// A cube of 1 m, m tetrahedra's edges wide, constrained on its underside: the system of a step of 0.1 s.
struct Step {
  MassSpringModel model;
  Forces forces;
  std::optional<EquationOfMotion> motion;
  std::optional<ImplicitMatrix> A;
  std::vector<Eigen::Matrix3d> inverse;

  Step(int m, const char* calibration) {
    const TetMesh mesh = box_tets(m, m, m, 1. / m, 0.2);
    model = calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface}, {1e6, 0.25, 1000, 0},
                      find_calibration(calibration));
    forces = no_forces(model);
    const Eigen::Matrix3d across = Eigen::Vector3d(1, 1, 0).asDiagonal();  // where the upper side slides
    for (int i = 0; i < mesh.X.cols(); ++i)
      if (const double z = mesh.X(2, i); z == mesh.X.row(2).minCoeff())
        forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
      else if (z == mesh.X.row(2).maxCoeff())
        forces.constraints.push_back({i, across, Eigen::Vector3d::Zero()});
    motion.emplace(model, forces);
    A.emplace(*motion);
    const State state = initial_state(model);
    A->set(state, state.x, {1, 1e-2, 0.1}, Curvature::Projected);
    A->system().diagonal(inverse);
    for (Eigen::Matrix3d& block : inverse) block = block.inverse().eval();
  }

  Matrix3Xd right_side(std::uint64_t seed) const {
    Matrix3Xd b = random_points(static_cast<int>(model.network.X.cols()), 1, seed);
    filter(forces.constraints, b);
    return b;
  }
};

/// z of apply, widened, of a right-hand side of any size.
void apply(Multigrid& multigrid, const Matrix3Xd& r, Matrix3Xd& z) {
  PaddedField single_r, single_z;
  pad(r, 1, single_r);
  const double r_z = multigrid.apply(single_r, single_z);
  EXPECT_NEAR(r_z, dot(single_r, single_z), kSingleRounding * r_z);
  z = Matrix3Xd::Zero(3, r.cols());
  add_unpadded(single_z, 1, z);
}

class MultigridOf : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(, MultigridOf, testing::Values("van_gelder", "edge_coupled", "node_averaged"),
                         [](const auto& info) { return std::string(info.param); });

TEST_P(MultigridOf, IsSymmetricPositiveDefiniteAndKeepsConstraints) {
  Step step(6, GetParam());
  const LinearSystem A = step.A->system();
  Multigrid multigrid(A.matrix(), *A.positions, A.constrain);
  const Matrix3Xd u = step.right_side(1), v = step.right_side(2);
  Matrix3Xd Mu, Mv;
  apply(multigrid, u, Mu);
  apply(multigrid, v, Mv);
  const double uMv = u.cwiseProduct(Mv).sum(), size = u.norm() * Mv.norm();
  ASSERT_GT(std::abs(uMv), 1e-6 * size);
  EXPECT_NEAR(v.cwiseProduct(Mu).sum(), uMv, kSingleRounding * size);
  EXPECT_GT(u.cwiseProduct(Mu).sum(), 0);
  for (const Constraint& c : step.forces.constraints) EXPECT_EQ(c.S * Mu.col(c.node), Mu.col(c.node));
}

/// Stiffness of springs along the edges (N/m), and a mass that is as small beside them as in a long step.
BlockMatrix springs_of(const Matrix3Xd& X, const Eigen::Matrix2Xi& E, double stiffness, double mass) {
  BlockMatrix A = make_block_matrix(static_cast<int>(X.cols()), E);
  for (int i = 0; i < A.rows(); ++i) A.block[A.diagonal[i]] = mass * Eigen::Matrix3d::Identity();
  for (const auto& e : E.colwise()) {
    const Eigen::Vector3d n = (X.col(e(1)) - X.col(e(0))).normalized();
    const Eigen::Matrix3d k = stiffness * n * n.transpose();
    for (int c : {0, 1}) {
      A.block[A.diagonal[e(c)]] += k;
      A.block[A.find(e(c), e(1 - c))] -= k;
    }
  }
  return A;
}

// Threads of nodes hang from a cube: across them nothing but mass resists, less than single precision tells.
TEST(Multigrid, OfNodesThatHangOnAThreadIsPositiveDefinite) {
  constexpr int kThreads = 20, kNodes = 6;
  const TetMesh cube = box_tets(7, 7, 7, 1. / 7, 0.1);
  const auto n = static_cast<int>(cube.X.cols());
  Matrix3Xd X(3, n + kThreads * kNodes);
  X.leftCols(n) = cube.X;
  std::vector<Eigen::Vector2i> edges;
  for (const auto& t : cube.T.colwise())
    for (int a = 0; a < 4; ++a)
      for (int b = 0; b < a; ++b) edges.emplace_back(t(a), t(b));
  for (int thread = 0; thread < kThreads; ++thread)
    for (int k = 0; k < kNodes; ++k) {
      const int node = n + thread * kNodes + k, above = k == 0 ? 17 * thread : node - 1;
      X.col(node) = X.col(above) + 0.1 * Eigen::Vector3d(0.5, 0.3, 0.8);
      edges.emplace_back(node, above);
    }
  Eigen::Matrix2Xi E(2, edges.size());
  for (std::size_t e = 0; e < edges.size(); ++e) E.col(static_cast<Eigen::Index>(e)) = edges[e];
  Multigrid multigrid(springs_of(X, E, 1e5, 0.01), X, [](Matrix3Xd&) {});
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    PaddedField r, z;
    pad(random_points(static_cast<int>(X.cols()), 1, seed), 1, r);
    EXPECT_GT(multigrid.apply(r, z), 0);
  }
}

TEST_P(MultigridOf, IterationsHardlyGrowWithTheNodesWhereBlockJacobisDo) {
  int iterations[2][2];
  for (const int k : {0, 1}) {
    Step step(k == 0 ? 5 : 15, GetParam());
    const LinearSystem A = step.A->system();
    Multigrid multigrid(A.matrix(), *A.positions, A.constrain);
    const Matrix3Xd b = step.right_side(3);
    const auto solve = [&](const auto& precondition) {
      Matrix3Xd x = Matrix3Xd::Zero(3, b.cols());
      const SolveReport report = conjugate_gradients(A.product, precondition, b, x, 1e-8, 1000);
      EXPECT_TRUE(report.is_converged);
      return report.iterations;
    };
    iterations[k][0] = solve([&](const Matrix3Xd& r, Matrix3Xd& z) {
      z.resizeLike(r);
      for (int i = 0; i < r.cols(); ++i) z.col(i) = step.inverse[i] * r.col(i);
    });
    iterations[k][1] = solve([&](const Matrix3Xd& r, Matrix3Xd& z) { apply(multigrid, r, z); });
  }
  EXPECT_GT(iterations[1][0], 2.5 * iterations[0][0]);
  EXPECT_LT(iterations[1][1], 1.7 * iterations[0][1]);
  EXPECT_LT(iterations[1][1], 30);
}

// Groups of all that touch would be too long, and take more than twice the iterations.
TEST(Multigrid, GroupsFollowTheBendingOfASlenderBar) {
  const TetMesh mesh = box_tets(2, 2, 1600, 1, 0.1);
  const MassSpringModel model = calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface},
                                          {1e6, 0.25, 1000, 0}, find_calibration("edge_coupled"));
  std::vector<Constraint> held;
  for (int i = 0; i < mesh.X.cols(); ++i)
    if (mesh.X(2, i) < 0.5) held.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  BlockMatrix A = stiffness_pattern(model);
  add_stiffness(model, initial_state(model), A);
  filter(held, A);
  Multigrid multigrid(A, mesh.X, [&](Matrix3Xd& u) { filter(held, u); });
  Matrix3Xd b = random_points(static_cast<int>(mesh.X.cols()), 1, 3), x = Matrix3Xd::Zero(3, b.cols());
  filter(held, b);
  const SolveReport report = conjugate_gradients(
      [&](const Matrix3Xd& p, Matrix3Xd& y) { multiply(A, p, y); },
      [&](const Matrix3Xd& r, Matrix3Xd& z) { apply(multigrid, r, z); }, b, x, 1e-4, 1000);
  EXPECT_TRUE(report.is_converged);
  EXPECT_LT(report.iterations, 90);
}

// A free body on soft ground: a rigid motion u meets the ground alone, A u = k u, and is found at once.
TEST(Multigrid, MovesAFreeBodyRigidlyWhereOneOfPiecewiseShiftsWouldNot) {
  constexpr double kGround = 1e-6;  // of the largest stiffness
  Step step(8, "edge_coupled");
  const Matrix3Xd& X = step.model.network.X;
  BlockMatrix A = stiffness_pattern(step.model);
  add_stiffness(step.model, initial_state(step.model), A);
  double largest = 0;
  for (const int k : A.diagonal) largest = std::max(largest, A.block[k].diagonal().maxCoeff());
  for (const int k : A.diagonal) A.block[k].diagonal().array() += kGround * largest;
  Multigrid multigrid(A, X, [](Matrix3Xd&) {});
  const Eigen::Vector3d axis(1, 2, -1), centre = X.rowwise().mean();
  for (const bool is_turned : {false, true}) {
    Matrix3Xd u = axis.replicate(1, X.cols()), z;
    if (is_turned)
      for (Eigen::Index i = 0; i < X.cols(); ++i) u.col(i) = axis.cross(X.col(i) - centre);
    apply(multigrid, kGround * largest * u, z);
    EXPECT_LT((z - u).norm(), 0.02 * u.norm()) << is_turned;
  }
}

}  // namespace
}  // namespace testbed::massspring
