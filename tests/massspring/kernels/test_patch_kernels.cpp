#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <numeric>
#include <vector>

#include "massspring/energies/tet_springs.h"
#include "massspring/kernels/padded_nodes.h"
#include "tests/meshing/box_tets.h"

#ifdef TESTBED_PLAIN
// The library's kernels, with vectors: their parameters are of another type than those built here.
typedef double LibraryDouble4 __attribute__((vector_size(32), aligned(8)));
namespace testbed::massspring {
void measure_patches(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                     const LibraryDouble4* u, double* det_1, double* squares_3);
void add_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                      const LibraryDouble4* u, LibraryDouble4* f);
void add_patch_hessians(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                        const LibraryDouble4* u, Curvature curvature, const int* at, Eigen::Matrix3d* block);
void add_linear_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                             const LibraryDouble4* u, LibraryDouble4* f);
}  // namespace testbed::massspring
#endif

namespace testbed::massspring {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

struct Case {
  TetMesh mesh = box_tets(8, 8, 9, 1. / 9, 0.2);  // large enough to be ordered along the body
  TetSprings springs = couple_springs(mesh.X, mesh.T, {2, 1}, {0.2, 0.5, 0.3});
  Eigen::VectorXd scale = Eigen::VectorXd::LinSpaced(springs.n_patches(), 0.6, 1.4);
  Matrix3Xd u = mesh.X, x;

  explicit Case(double displacement = 0.05) {
    Random random(3);
    for (double& c : u.reshaped()) c = displacement * (2 * random.uniform() - 1);
    x = mesh.X + u;
  }
  PatchArrays arrays() const {
    return {springs.volume.data(), springs.lambda.data(), scale.data(), springs.mu};
  }
};

TEST(PatchBatches, HoldTheVectorsOfEveryPatchAndZeros) {
  const Case of;
  const PatchBatches& batches = of.springs.batches;
  Eigen::Index n_entries = 0, n_filled = 0;
  for (int batch = 0; batch < batches.n_batches(); ++batch)
    for (int lane = 0; lane < kBatchSize; ++lane) {
      const int p = batches.first[batch] + lane;
      Eigen::Matrix3d there = Eigen::Matrix3d::Zero(), expected = there;
      for (int e = batches.start[batch]; e < batches.start[batch + 1]; ++e, ++n_filled)
        for (int j = 0; j < 3; ++j)
          there.col(j) +=
              batches.b[kBatchSize * (3 * e + j) + lane] * of.mesh.X.col(batches.node[kBatchSize * e + lane]);
      if (p < batches.first[batch + 1]) {
        expected.setIdentity();
        n_entries += of.springs.first[p + 1] - of.springs.first[p];
      }
      EXPECT_LT((there - expected).norm(), 1e-12);
    }
  EXPECT_EQ(batches.first.back(), of.springs.n_patches());
  EXPECT_LT(static_cast<double>(n_filled), 1.1 * static_cast<double>(n_entries)) << "little is filled up";
}

TEST(PatchKernels, MeasuresAreThoseOfTheSumOverNodes) {
  const Case of;
  const PatchBatches& batches = of.springs.batches;
  std::vector<double> det(of.springs.n_patches()), squares(det.size());
  measure_patches(0, batches.n_batches(), batches, of.arrays(), pad(of.u), det.data(), squares.data());
  for (int p = 0; p < of.springs.n_patches(); ++p) {
    Eigen::Matrix3d F = Eigen::Matrix3d::Zero();
    for (int e = of.springs.first[p]; e < of.springs.first[p + 1]; ++e)
      F += of.x.col(of.springs.node[e]) * of.springs.b(p, e).transpose() / of.scale[p];
    EXPECT_NEAR(1 + det[p], F.determinant(), 1e-12);
    EXPECT_NEAR(3 + squares[p], F.squaredNorm(), 1e-12);
  }
}

/// psi'' at F over its columns, a column for each direction dF, and its negative eigenvalues set to 0.
Matrix9d second_derivative(const Matrix3d& F, double lambda, double mu, Curvature curvature) {
  constexpr double kJ0 = 0.1;  // where the law turns to its expansion
  const auto cofactor = [](const Matrix3d& A, const Matrix3d& B) {
    Matrix3d C;
    for (int j = 0; j < 3; ++j) C.col(j) = A.col((j + 1) % 3).cross(B.col((j + 2) % 3));
    return C;
  };
  const double J = F.determinant(), j = std::max(J, kJ0), c = mu + lambda / 2;
  const double ddg = lambda / 2 + c / (j * j), dg = lambda / 2 * j - c / j + ddg * (J - j);
  Matrix9d H;
  for (int k = 0; k < 9; ++k) {
    Matrix3d dF = Matrix3d::Zero();
    dF.reshaped()[k] = 1;
    const Matrix3d C = cofactor(F, F);
    H.col(k) =
        (mu * dF + ddg * C.cwiseProduct(dF).sum() * C + dg * (cofactor(dF, F) + cofactor(F, dF))).reshaped();
  }
  if (curvature == Curvature::Exact) return H;
  const Eigen::SelfAdjointEigenSolver<Matrix9d> eigen(H);
  return eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() *
         eigen.eigenvectors().transpose();
}

TEST(PatchKernels, HessiansAreThoseOfThePatchesOneByOneAlsoWhereTheyAreInverted) {
  constexpr double kBatchedTolerance = 1e-13;
  const Case of(0.15);
  const TetSprings& springs = of.springs;
  ASSERT_LT(smallest_jacobian(springs, of.u), -0.1);
  for (const Curvature curvature : {Curvature::Exact, Curvature::Projected}) {
    BlockMatrix K = make_block_matrix(static_cast<int>(of.x.cols()), pairs_of(springs)), expected = K;
    add_hessian(springs, of.u, K, curvature, of.scale);
    mirror(K);
    for (int p = 0; p < springs.n_patches(); ++p) {
      const double s = of.scale[p];
      Matrix3d F = Matrix3d::Zero();
      for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
        F += of.x.col(springs.node[e]) * springs.b(p, e).transpose() / s;
      const Matrix9d H =
          s * springs.volume[p] * second_derivative(F, springs.lambda[p], springs.mu, curvature);
      for (int r = springs.first[p]; r < springs.first[p + 1]; ++r)
        for (int e = springs.first[p]; e < springs.first[p + 1]; ++e)
          for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b)
              expected.block[expected.find(springs.node[r], springs.node[e])] +=
                  springs.b(p, r)[a] * springs.b(p, e)[b] * H.block<3, 3>(3 * a, 3 * b);
    }
    double size = 0;
    for (const Matrix3d& block : expected.block) size = std::max(size, block.norm());
    for (std::size_t k = 0; k < K.block.size(); ++k)
      ASSERT_LT((K.block[k] - expected.block[k]).norm(), kBatchedTolerance * size);
  }
}

TEST(PatchKernels, LinearForcesAndProductsAreThoseOfTheHessianAtRest) {
  const Case of;
  const Eigen::Index n = of.u.cols();
  BlockMatrix K = make_block_matrix(static_cast<int>(n), pairs_of(of.springs));
  add_hessian(of.springs, Matrix3Xd::Zero(3, n), K, Curvature::Exact);
  mirror(K);
  Matrix3Xd Ku, f = Matrix3Xd::Zero(3, n);
  multiply(K, of.u, Ku);
  add_linear_forces(of.springs, of.u, f);
  EXPECT_LT((f + Ku).norm(), 1e-13 * Ku.norm());

  PaddedField p, y;
  meshing::pad(of.u, 1, p);
  y.setZero(4, p.cols());
  add_product(of.springs, single_precision(of.springs), p, y);
  EXPECT_LT((y.topLeftCorner(3, n).cast<double>() - Ku).norm(), 1e-6 * Ku.norm());
  EXPECT_TRUE(y.row(3).isZero(0));

  std::vector<Matrix3d> blocks(n, Matrix3d::Identity());
  add_diagonal(of.springs, 2, blocks);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Matrix3d expected = Matrix3d::Identity() + 2 * K.block[K.diagonal[i]];
    EXPECT_LT((blocks[i] - expected).norm(), 1e-13 * expected.norm());
  }
}

#ifdef TESTBED_PLAIN
TEST(PatchKernels, GiveTheSameBitsWithVectorsAndWithout) {
  const Case of(0.15);
  const PatchBatches& batches = of.springs.batches;
  const auto n = static_cast<std::size_t>(of.u.cols());
  std::vector<Double4> f(n, Double4{});
  const Double4* const u = pad(of.u);
  add_patch_forces(0, batches.n_batches(), batches, of.arrays(), u, f.data());
  std::vector<double> by_vectors(4 * n, 0.), det(of.springs.n_patches()), squares = det, det_2 = det,
                                                                          squares_2 = det;
  add_patch_forces(0, batches.n_batches(), batches, of.arrays(), reinterpret_cast<const LibraryDouble4*>(u),
                   reinterpret_cast<LibraryDouble4*>(by_vectors.data()));
  add_linear_patch_forces(0, batches.n_batches(), batches, of.arrays(), u, f.data());
  add_linear_patch_forces(0, batches.n_batches(), batches, of.arrays(),
                          reinterpret_cast<const LibraryDouble4*>(u),
                          reinterpret_cast<LibraryDouble4*>(by_vectors.data()));
  for (std::size_t i = 0; i < n; ++i)
    for (int k = 0; k < 3; ++k) EXPECT_EQ(f[i][k], by_vectors[4 * i + k]);
  measure_patches(0, batches.n_batches(), batches, of.arrays(), u, det.data(), squares.data());
  measure_patches(0, batches.n_batches(), batches, of.arrays(), reinterpret_cast<const LibraryDouble4*>(u),
                  det_2.data(), squares_2.data());
  EXPECT_EQ(det, det_2);
  EXPECT_EQ(squares, squares_2);

  for (const Curvature curvature : {Curvature::Exact, Curvature::Projected}) {
    std::vector<int> at(kBatchSize * batches.pair_start.back());
    std::iota(at.begin(), at.end(), 0);
    std::vector<Matrix3d> blocks(at.size(), Matrix3d::Zero()), blocks_2 = blocks;
    add_patch_hessians(0, batches.n_batches(), batches, of.arrays(), u, curvature, at.data(), blocks.data());
    add_patch_hessians(0, batches.n_batches(), batches, of.arrays(),
                       reinterpret_cast<const LibraryDouble4*>(u), curvature, at.data(), blocks_2.data());
    EXPECT_EQ(blocks, blocks_2);
  }
}
#endif

}  // namespace
}  // namespace testbed::massspring
