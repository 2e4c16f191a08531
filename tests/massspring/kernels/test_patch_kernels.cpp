#include <gtest/gtest.h>

#include <Eigen/LU>

#include "massspring/energies/tet_springs.h"
#include "massspring/kernels/padded_nodes.h"
#include "tests/meshing/box_tets.h"

#ifdef TESTBED_PLAIN
// The library's kernels, with vectors: their parameters are of another type than those built here.
typedef double LibraryDouble4 __attribute__((vector_size(32), aligned(8)));
namespace testbed::massspring {
void measure_patches(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                     const LibraryDouble4* x, double* det, double* squared_norm);
void add_patch_forces(int begin, int end, const PatchBatches& batches, const PatchArrays& of,
                      const LibraryDouble4* x, LibraryDouble4* f);
}  // namespace testbed::massspring
#endif

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

struct Case {
  TetMesh mesh = box_tets(8, 8, 9, 1. / 9, 0.2);  // large enough to be ordered along the body
  TetSprings springs = couple_springs(mesh.X, mesh.T, {2, 1}, {0.2, 0.5, 0.3});
  Eigen::VectorXd scale = Eigen::VectorXd::LinSpaced(springs.n_patches(), 0.6, 1.4);
  Matrix3Xd x = mesh.X;

  Case() {
    Random random(3);
    for (double& c : x.reshaped()) c += 0.05 * (2 * random.uniform() - 1);
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
  measure_patches(0, batches.n_batches(), batches, of.arrays(), pad(of.x), det.data(), squares.data());
  for (int p = 0; p < of.springs.n_patches(); ++p) {
    Eigen::Matrix3d F = Eigen::Matrix3d::Zero();
    for (int e = of.springs.first[p]; e < of.springs.first[p + 1]; ++e)
      F += of.x.col(of.springs.node[e]) * of.springs.b.col(e).transpose() / of.scale[p];
    EXPECT_NEAR(det[p], F.determinant(), 1e-12);
    EXPECT_NEAR(squares[p], F.squaredNorm(), 1e-12);
  }
}

#ifdef TESTBED_PLAIN
TEST(PatchKernels, GiveTheSameBitsWithVectorsAndWithout) {
  const Case of;
  const PatchBatches& batches = of.springs.batches;
  const auto n = static_cast<std::size_t>(of.x.cols());
  std::vector<Double4> f(n, Double4{});
  const Double4* const x = pad(of.x);
  add_patch_forces(0, batches.n_batches(), batches, of.arrays(), x, f.data());
  std::vector<double> by_vectors(4 * n, 0.), det(of.springs.n_patches()), squares = det, det_2 = det,
                                                                          squares_2 = det;
  add_patch_forces(0, batches.n_batches(), batches, of.arrays(), reinterpret_cast<const LibraryDouble4*>(x),
                   reinterpret_cast<LibraryDouble4*>(by_vectors.data()));
  for (std::size_t i = 0; i < n; ++i)
    for (int k = 0; k < 3; ++k) EXPECT_EQ(f[i][k], by_vectors[4 * i + k]);
  measure_patches(0, batches.n_batches(), batches, of.arrays(), x, det.data(), squares.data());
  measure_patches(0, batches.n_batches(), batches, of.arrays(), reinterpret_cast<const LibraryDouble4*>(x),
                  det_2.data(), squares_2.data());
  EXPECT_EQ(det, det_2);
  EXPECT_EQ(squares, squares_2);
}
#endif

}  // namespace
}  // namespace testbed::massspring
