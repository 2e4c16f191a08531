#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "massspring/calibrations/calibrate.h"
#include "massspring/time/implicit_matrix.h"
#include "meshing/algebra/conjugate_gradients.h"
#include "meshing/algebra/multigrid.h"
#include "meshing/algebra/strong_couplings.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"
#include "tests/meshing/flat_tetrahedra.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSingleRounding = 1e-4;

/// The stiffness of linear elements on a box with a part of its tetrahedra parted, and held at one end.
struct Box {
  TetMesh mesh;
  std::vector<Constraint> held;
  BlockMatrix A;

  Box(int m, double part_of_volume) : Box(box_tets(m, m, 2 * m, 1. / m, 0.2), part_of_volume) {}
  Box(TetMesh tets, double part_of_volume) : mesh(std::move(tets)) {
    if (part_of_volume < 1) meshing::add_flat_tetrahedra(mesh, part_of_volume);
    const MassSpringModel model = calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface},
                                            {1e6, 0.25, 1000, 0}, find_calibration("edge_coupled"));
    for (int i = 0; i < mesh.X.cols(); ++i)
      if (mesh.X(2, i) < 0.1) held.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
    A = stiffness_pattern(model);
    add_stiffness(model, initial_state(model), A);
    filter(held, A);
  }

  StrongCouplings strong() const { return {A, meshing::single_precision(A), mesh.X}; }
  int iterations_of_multigrid() const {
    Multigrid multigrid(A, mesh.X, [&](Matrix3Xd& u) { filter(held, u); });
    Matrix3Xd b = random_points(static_cast<int>(mesh.X.cols()), 1, 3), x = Matrix3Xd::Zero(3, b.cols());
    filter(held, b);
    const SolveReport report =
        conjugate_gradients([&](const Matrix3Xd& p, Matrix3Xd& y) { multiply(A, p, y); },
                            [&](const Matrix3Xd& r, Matrix3Xd& z) {
                              PaddedField single_r, single_z;
                              const double size = r.norm();
                              pad(r, 1 / size, single_r);
                              multigrid.apply(single_r, single_z);
                              z = Matrix3Xd::Zero(3, r.cols());
                              add_unpadded(single_z, size, z);
                            },
                            b, x, 1e-6, 1000);
    EXPECT_TRUE(report.is_converged);
    return report.iterations;
  }
};

MatrixXd dense(const BlockMatrix& A) {
  MatrixXd full = MatrixXd::Zero(3 * A.rows(), 3 * A.rows());
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      full.block<3, 3>(3 * i, 3 * A.column[k]) = A.block[k];
  return full;
}

TEST(StrongCouplings, AreThoseOfFlatTetrahedra) {
  EXPECT_EQ(Box(4, 1).strong().n_nodes(), 0);
  const Box parted(4, 1e-3);
  const auto n_parted = static_cast<int>(parted.mesh.X.cols() - Box(4, 1).mesh.X.cols());
  EXPECT_GE(parted.strong().n_nodes(), 3 * n_parted);  // tetrahedra may share corners, and some are held
  EXPECT_LE(parted.strong().n_nodes(), 4 * n_parted);
}

// A coupling of good tetrahedra is as strong as they are large.
TEST(StrongCouplings, AreNotThoseOfLargeTetrahedra) {
  TetMesh mesh = box_tets(5, 5, 5, 0.2, 0.2);
  const TetMesh large = box_tets(2, 2, 2, 20, 0.2);
  const Eigen::Index n = mesh.X.cols(), m = mesh.T.cols();
  mesh.X.conservativeResize(Eigen::NoChange, n + large.X.cols());
  mesh.X.rightCols(large.X.cols()) = large.X;
  mesh.T.conservativeResize(Eigen::NoChange, m + large.T.cols());
  mesh.T.rightCols(large.T.cols()) = large.T.array() + static_cast<int>(n);
  EXPECT_EQ(Box(mesh, 1).strong().n_nodes(), 0);
}

TEST(StrongCouplings, LeaveAPreconditionerAloneWhereThereAreNone) {
  const Box box(3, 1);
  PaddedField r, z;
  pad(random_points(static_cast<int>(box.mesh.X.cols()), 1, 1), 1, r);
  box.strong().around([](const PaddedField& b, PaddedField& x) { x = 2 * b; }, r, z);
  EXPECT_TRUE(z == 2 * r);
}

// Brute force: S = P^T (P A P^T)^-1 P before and after B = 1e-7, with dense matrices. Nodes are picked as those that move
// where B does nothing.
TEST(StrongCouplings, CorrectTheirNodesBeforeAndAfter) {
  constexpr double kB = 1e-7;  // m/N
  const Box box(3, 1e-2);
  const StrongCouplings strong = box.strong();
  const Eigen::Index n = box.mesh.X.cols();
  const auto apply = [&](const VectorXd& r, double factor) -> VectorXd {
    PaddedField single_r, z;
    pad(r.reshaped(3, n), 1, single_r);
    strong.around([&](const PaddedField& b, PaddedField& x) { x = static_cast<float>(factor) * b; }, single_r,
                  z);
    Matrix3Xd result = Matrix3Xd::Zero(3, n);
    add_unpadded(z, 1, result);
    return result.reshaped();
  };
  const VectorXd some = random_points(static_cast<int>(n), 1, 2).reshaped();
  const VectorXd moved = apply(some, 0);
  std::vector<Eigen::Index> unknowns;
  for (Eigen::Index k = 0; k < 3 * n; ++k)
    if (moved(k) != 0) unknowns.push_back(k);
  ASSERT_EQ(static_cast<int>(unknowns.size()), 3 * strong.n_nodes());
  const MatrixXd A = dense(box.A);
  MatrixXd S = MatrixXd::Zero(3 * n, 3 * n);
  const MatrixXd part = A(unknowns, unknowns), inverse = part.inverse();
  S(unknowns, unknowns) = inverse;
  const MatrixXd I = MatrixXd::Identity(3 * n, 3 * n);
  const MatrixXd left = (I - S * A) * (I - kB * A) * (I - S * A);  // of an error
  const VectorXd u = random_points(static_cast<int>(n), 1, 4).reshaped();
  const VectorXd expected = u - left * u;
  EXPECT_LT((apply(A * u, kB) - expected).norm(), kSingleRounding * expected.norm());
}

// Without the corrections it takes several times as many.
TEST(StrongCouplings, SpareMultigridItsIterationsOnFlatTetrahedra) {
  const int even = Box(6, 1).iterations_of_multigrid();
  for (const double part_of_volume : {1e-2, 1e-4})
    EXPECT_LT(Box(6, part_of_volume).iterations_of_multigrid(), 1.5 * even);
}

}  // namespace
}  // namespace testbed::massspring
