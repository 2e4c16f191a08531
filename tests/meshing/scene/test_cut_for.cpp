#include <gtest/gtest.h>

#include "meshing/scene/scene.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/surfaces.h"

namespace testbed::meshing {
namespace {

/// Held below x = 0.5 m of 4; its edges are some 0.3 m long.
Scene clamped_bar(int at_supports) {
  Scene scene;
  scene.surface.across = 0;
  scene.surface.at_supports = at_supports;
  Support support;
  support.region.shape = HalfSpace{{0.5, 0, 0}, {1, 0, 0}};
  scene.supports = {support};
  return scene;
}

double area_of(const std::vector<int>& triangles, const SurfaceMesh& surface) {
  return area_vectors(surface.X, surface.F)(Eigen::all, triangles).colwise().norm().sum();
}

TEST(CutFor, HalvesEdgesAtBordersOfSupportsAlone) {
  const SurfaceMesh bar = make_shape("bar", 300, {4, 1, 1});
  const double edge = longest_edges(bar).maxCoeff();
  const Region held = clamped_bar(0).supports[0].region;
  const double area = area_of(triangles_in(held, bar), bar);
  ASSERT_GT(area, 1);
  for (const int times : {1, 2, 3}) {
    const SurfaceMesh cut = cut_for(clamped_bar(times), bar).surface;
    EXPECT_NEAR(volume(cut.X, cut.F), volume(bar.X, bar.F), 1e-12);
    EXPECT_NEAR(area_of(triangles_in(held, cut), cut), area, 1e-12) << "the support ends where it did";
    const Eigen::VectorXd longest = longest_edges(cut);
    std::vector<bool> is_held(cut.X.cols());
    for (const int v : vertices_in(held, cut)) is_held[v] = true;
    int n_far = 0, n_border = 0;
    for (Eigen::Index f = 0; f < cut.F.cols(); ++f) {
      const auto t = cut.F.col(f);
      const int n_held = is_held[t[0]] + is_held[t[1]] + is_held[t[2]];
      if (n_held > 0 && n_held < 3) {
        EXPECT_LE(longest[f], edge / (1 << times) * (1 + 1e-12));
        ++n_border;
      }
      const double x = cut.X(0, t).minCoeff();
      if (x > 2.5) {
        EXPECT_EQ((cut.X(Eigen::all, t) - bar.X(Eigen::all, bar.F.col(cut.cuts.parent[f]))).norm(), 0);
        ++n_far;
      }
    }
    EXPECT_GT(n_border, 10);
    EXPECT_GT(n_far, 10);
  }
}

TEST(CutFor, LeavesWhatASupportHoldsAllAround) {
  const SurfaceMesh bar = make_shape("bar", 300, {4, 1, 1});
  Scene scene = clamped_bar(1);
  scene.supports[0].region.shape = HalfSpace{{2, 0, 0}, {1, 0, 0}};
  const SurfaceMesh cut = cut_for(scene, bar).surface;
  int n_inner = 0;
  for (Eigen::Index f = 0; f < cut.F.cols(); ++f)
    if (cut.X(0, cut.F.col(f)).maxCoeff() < 0.5) {
      EXPECT_EQ(cut.F.col(f), bar.F.col(cut.cuts.parent[f]));
      ++n_inner;
    }
  EXPECT_GT(n_inner, 10);
}

TEST(CutFor, LeavesABodyThatNothingHoldsAsItIs) {
  const SurfaceMesh bar = make_shape("bar", 100, {4, 1, 1});
  Scene scene = clamped_bar(3);
  scene.supports.clear();
  EXPECT_EQ(cut_for(scene, bar).surface.X, bar.X);
}

/// Scenes that name a part of the surface in each of the ways there are.
std::vector<Scene> scenes_of(const Region& region) {
  Support support;
  support.region = region;
  Seam from, to;
  from.from = region;
  to.to = region;
  Load load;
  load.region = region;
  Handle handle;
  handle.region = region;
  std::vector<Scene> scenes(5);
  scenes[0].supports = {support};
  scenes[1].loads = {load};
  scenes[2].handles = {handle};
  scenes[3].seams = {from};
  scenes[4].seams = {to};
  return scenes;
}

TEST(CutFor, LeavesTheAreaOfEveryRegion) {
  const SurfaceMesh plate = fanned_plate(21);
  for (const bool is_relative : {false, true}) {
    const Region region{HalfSpace{{is_relative ? 0.45 : 0.9, 0, 0}, {1, 0, 0}}, is_relative};
    const double area = area_of(triangles_in(region, plate), plate);
    ASSERT_GT(area, 0.5);
    for (const Scene& scene : scenes_of(region)) {
      const SurfaceMesh cut = cut_for(scene, plate).surface;
      ASSERT_GT(cut.X.cols(), plate.X.cols());
      EXPECT_NEAR(area_of(triangles_in(region, cut), cut), area, 1e-12);
    }
    const SurfaceMesh cut = cut_for({}, plate).surface;
    EXPECT_GT(std::abs(area_of(triangles_in(region, cut), cut) - area), 0.01) << "where no scene names it";
  }
}

}  // namespace
}  // namespace testbed::meshing
