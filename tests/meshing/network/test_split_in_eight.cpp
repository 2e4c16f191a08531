#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "meshing/base/geometry.h"
#include "meshing/network/build_network.h"
#include "meshing/network/split_in_eight.h"
#include "meshing/surface/cut_surface.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/tet_mesh.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

SpringNetwork torus() {
  return build_network(make_shape("torus", 120), {}, false, true);
}

SurfaceMesh surface_of(const SpringNetwork& network) {
  return {network.X.leftCols(network.n_surface), network.F, network.cuts};
}

}  // namespace

TEST(SplitInEight, FillsTheSameSurfaceWithEightPartsOfEachTetrahedron) {
  const SpringNetwork before = torus(), after = split_in_eight(before).network;
  ASSERT_EQ(after.T.cols(), 8 * before.T.cols());
  ASSERT_EQ(after.F.cols(), 4 * before.F.cols());
  EXPECT_NO_THROW(check_tetrahedra({after.X, after.T, after.F, after.n_surface}, surface_of(after)));
  for (Eigen::Index t = 0; t < after.T.cols(); ++t) {
    const double whole = tet_volume(before.X, before.T.col(t / 8));
    EXPECT_NEAR(tet_volume(after.X, after.T.col(t)), whole / 8, 1e-9 * whole);
  }
}

TEST(SplitInEight, KeepsTheVerticesBitForBitAndNamesWhereNodesLie) {
  const SpringNetwork before = torus();
  const auto [after, between] = split_in_eight(before);
  EXPECT_EQ(after.X.leftCols(before.n_surface), before.X.leftCols(before.n_surface));
  Eigen::Matrix3d A;
  A << 1, 2, 3, -1, 0, 2, 5, -2, 1;
  EXPECT_TRUE(interpolated(A * before.X, between).isApprox(A * after.X, 1e-14));
  Eigen::Index n_before = 0;
  for (const auto& ends : between.colwise()) n_before += ends[0] == ends[1];
  EXPECT_EQ(n_before, before.X.cols());
}

TEST(SplitInEight, CutsThePiecesOfACutSurfaceFromWhatThoseWereCutFrom) {
  const SurfaceMesh bar = make_shape("bar", 60),
                    cut = cut_surface(bar, longest_edges(bar) / 2, std::numeric_limits<int>::max());
  const SpringNetwork network = build_network(cut, {}, false, true), after = split_in_eight(network).network;
  ASSERT_EQ(after.cuts.F, bar.F);
  for (int v = 0; v < after.n_surface; ++v)
    EXPECT_TRUE(lies_among(after.X.col(v), bar.X(Eigen::all, after.cuts.between.col(v))));
  for (int f = 0; f < after.F.cols(); ++f) {
    const Eigen::Vector3i corners = bar.F.col(after.cuts.parent[f]);
    EXPECT_TRUE(lies_among(after.X(Eigen::all, after.F.col(f)).rowwise().mean(), bar.X(Eigen::all, corners)));
  }
}

TEST(SplitInEight, NamesTheEdgeThatAMiddleLiesOn) {
  const SpringNetwork before = torus();
  const auto [after, between] = split_in_eight(before);
  ASSERT_GT(after.n_surface, before.n_surface);
  for (int v = before.n_surface; v < after.n_surface; ++v) {
    const Eigen::Vector3i around = after.cuts.between.col(v);
    const Eigen::Vector2i ends = between.col(v);
    EXPECT_EQ(std::set<int>(around.begin(), around.end()), std::set<int>(ends.begin(), ends.end()));
  }
}
