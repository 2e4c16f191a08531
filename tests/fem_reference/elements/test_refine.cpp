#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>

#include "fem_reference/elements/refine.h"
#include "meshing/surface/surface.h"
#include "tests/fem_reference/tets.h"
#include "tests/meshing/box_tets.h"

namespace testbed::fem {
namespace {

TEST(Refine, FillsTheSameBodyWithTheSameFirstNodes) {
  const TetMesh coarse = box_tets(2, 3, 2, 0.5, 0.15), fine = refine(coarse);
  EXPECT_EQ(fine.T.cols(), 8 * coarse.T.cols());
  EXPECT_EQ(fine.F.cols(), 4 * coarse.F.cols());
  EXPECT_EQ(fine.n_surface, coarse.n_surface);
  EXPECT_EQ(fine.X.leftCols(coarse.X.cols()), coarse.X);
  double coarse_volume = 0, fine_volume = 0, smallest = 1;
  for (const auto& t : coarse.T.colwise()) coarse_volume += volume_of(coarse.X, t);
  for (const auto& t : fine.T.colwise()) {
    fine_volume += volume_of(fine.X, t);
    smallest = std::min(smallest, volume_of(fine.X, t));
  }
  EXPECT_GT(smallest, 0);
  EXPECT_NEAR(fine_volume, coarse_volume, 1e-14);
  EXPECT_NEAR(volume(fine.X, fine.F), coarse_volume, 1e-13);
}

TEST(Refine, TetrahedraMeetFaceToFace) {
  const TetMesh fine = refine(box_tets(2, 1, 1, 0.5, 0.1));
  std::map<std::array<int, 3>, int> count;
  for (const auto& t : fine.T.colwise())
    for (int k = 0; k < 4; ++k) {
      std::array<int, 3> face{{t((k + 1) % 4), t((k + 2) % 4), t((k + 3) % 4)}};
      std::sort(face.begin(), face.end());
      ++count[face];
    }
  for (const auto& f : fine.F.colwise()) {
    std::array<int, 3> face{{f(0), f(1), f(2)}};
    std::sort(face.begin(), face.end());
    EXPECT_EQ(count[face]++, 1) << "a boundary triangle is of one tetrahedron";
  }
  for (const auto& [face, n] : count) EXPECT_EQ(n, 2);
}

TEST(Refine, ChildrenOfBoundaryTrianglesFollowTheirParent) {
  const TetMesh coarse = box_tets(1, 1, 1, 1), fine = refine(coarse);
  const Eigen::Matrix3Xd parents = area_vectors(coarse.X, coarse.F), children = area_vectors(fine.X, fine.F);
  for (int f = 0; f < coarse.F.cols(); ++f)
    for (int k = 0; k < 4; ++k)
      EXPECT_LT((children.col(4 * f + k) - parents.col(f) / 4).norm(), 1e-15) << f << ' ' << k;
}

}  // namespace
}  // namespace testbed::fem
