#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "meshing/network/build_network.h"
#include "meshing/network/network.h"
#include "meshing/surface/cut_surface.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/tetrahedra/interior_size.h"
#include "meshing/tetrahedra/tet_mesh.h"

using namespace testbed::meshing;

namespace {

/// Tetrahedra that the line through x along `axis` passes.
int n_tetrahedra_along(const SpringNetwork& network, const Eigen::Vector3d& x, int axis) {
  int n = 0;
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  for (const auto& t : network.T.colwise()) {
    bool is_met = false;
    for (int skip = 0; skip < 4; ++skip) {  // the shadow of a tetrahedron is that of its faces
      double area[3], sum = 0;
      for (int c = 0; c < 3; ++c) {
        const Eigen::Vector3d a = network.X.col(t[(skip + 1 + c) % 4]) - x,
                              b = network.X.col(t[(skip + 1 + (c + 1) % 3) % 4]) - x;
        area[c] = a[u] * b[v] - a[v] * b[u];
        sum += area[c];
      }
      is_met = is_met || (area[0] * sum > 0 && area[1] * sum > 0 && area[2] * sum > 0);
    }
    n += is_met;
  }
  return n;
}

}  // namespace

TEST(BuildNetwork, SampledNodesKeepTheirPlacesAndGetTetrahedra) {
  const SurfaceMesh surface = make_shape("ball", 162);
  NetworkOptions options;
  options.seed = 3;
  SampleOptions sample;
  sample.seed = 3;
  const Eigen::Matrix3Xd darts = sample_interior(surface, sample);
  ASSERT_GT(darts.cols(), 50);
  const SpringNetwork network = build_network(surface, options, true, true);
  EXPECT_EQ(network.X.middleCols(162, darts.cols()), darts);
  EXPECT_LT(network.X.cols() - 162, 4 * darts.cols() / 3) << "few are added";
  EXPECT_NO_THROW(check_tetrahedra({network.X, network.T, network.F, network.n_surface}, surface));
}

TEST(BuildNetwork, HasLinksOnlyWhereTheyAreAskedFor) {
  const SurfaceMesh surface = make_shape("ball", 42);
  for (const bool needs_tetrahedra : {false, true}) {
    const SpringNetwork with = build_network(surface, {}, true, needs_tetrahedra),
                        without = build_network(surface, {}, false, needs_tetrahedra);
    EXPECT_GT(with.E.cols(), 0);
    EXPECT_EQ(without.E.cols(), 0);
    EXPECT_EQ(without.X, with.X);
    EXPECT_EQ(without.T, with.T);
    EXPECT_EQ(without.T.cols() > 0, needs_tetrahedra);
  }
}

TEST(BuildNetwork, PcpLinksTheMeshersNodes) {
  const SurfaceMesh surface = make_shape("torus", 300);
  NetworkOptions options;
  options.sampling = "mesher";
  const SpringNetwork network = build_network(surface, options, true, true);
  const Eigen::Index n_inner = network.X.cols() - network.n_surface;
  ASSERT_GT(n_inner, 0);
  EXPECT_EQ(network.E, link_pcp(surface, network.X.rightCols(n_inner), {}).E);
  EXPECT_NO_THROW(check_tetrahedra({network.X, network.T, network.F, network.n_surface}, surface));
}

TEST(BuildNetwork, PcpTakesTheTablesWeights) {
  const SurfaceMesh surface = make_shape("bar", 100, {2, 1, 0.5});
  NetworkOptions options;
  options.degree_weight = 0.2;  // of the smallest side, 0.5 m
  options.depth_weight = 0.5;
  const SpringNetwork network = build_network(surface, options, true, false);
  const auto is_linked_by = [&](double degree_weight, double depth_weight) {
    PcpOptions weights;
    weights.degree_weight = degree_weight;
    weights.depth_weight = depth_weight;
    const auto n_inner = network.X.cols() - network.n_surface;
    const Eigen::Matrix2Xi E = link_pcp(surface, network.X.rightCols(n_inner), weights).E;
    return E.cols() == network.E.cols() && E == network.E;
  };
  EXPECT_TRUE(is_linked_by(0.1, 0.5));
  EXPECT_FALSE(is_linked_by(0.4, 0.5));
  EXPECT_FALSE(is_linked_by(0.1, 0));
}

TEST(BuildNetwork, SpringsAloneTakeTheMeshersNodesToo) {
  const SurfaceMesh surface = make_shape("ball", 162);
  NetworkOptions options;
  options.sampling = "mesher";
  const SpringNetwork network = build_network(surface, options, true, false);
  EXPECT_EQ(network.X, build_network(surface, options, true, true).X);
  EXPECT_EQ(network.T.cols(), 0);
}

TEST(BuildNetwork, ThinBodiesGetLayers) {
  const SurfaceMesh plate = make_shape("bar", 400, {2, 2, 0.3});
  const Eigen::Vector3d x(0.013, 0.027, 0);
  for (const char* sampling : {"darts", "mesher"}) {
    NetworkOptions options;
    options.sampling = sampling;
    EXPECT_GE(n_tetrahedra_along(build_network(plate, options, true, true), x, 2), 4) << sampling;
  }
}

TEST(BuildNetwork, WhereAMesherHangsOnSampledNodesItsOwnTakeTheirPlace) {
  const TemporaryFolder workers;
  const std::string real = program_folder() / "gmsh_worker", fake = workers.path() / "gmsh_worker";
  const auto hang_once = [&] {  // and be the mesher from then on
    std::ofstream(fake) << "#!/bin/sh\nmv " << fake << ".real " << fake << "\nwhile :; do :; done\n";
    std::filesystem::permissions(fake, std::filesystem::perms::owner_all);
    std::filesystem::create_symlink(real, fake + ".real");
  };
  TetOptions tets;
  tets.workers = workers.path();
  tets.time_limit = 0.5;
  const SurfaceMesh ball = make_shape("ball", 162);
  NodeReport report;
  NetworkOptions mesher;
  mesher.sampling = "mesher";
  hang_once();
  EXPECT_EQ(place_nodes(ball, {}, true, &report, tets).X, place_nodes(ball, mesher, true).X);
  EXPECT_TRUE(report.is_mesher_instead);
  EXPECT_EQ(report.tets.mesher, "gmsh, Delaunay");
  EXPECT_EQ(report.tets.failures,
            std::vector<std::string>{"gmsh, Delaunay: stopped after 0.5 s of computing"});
  place_nodes(ball, {}, true, &report);
  EXPECT_FALSE(report.is_mesher_instead);
}

TEST(BuildNetwork, OfACutSurfaceOnWhichGmshFailsTetgenComesFirst) {
  const TemporaryFolder workers;
  for (const char* name : {"gmsh_worker", "tetgen_worker"}) {  // with nodes inside neither ends well
    std::ofstream(workers.path() / name)
        << "#!/bin/sh\n[ -e " << workers.path() / name << ".called ] && exec " << program_folder() / name
        << " \"$@\"\ntouch " << workers.path() / name << ".called; exit 1\n";
    std::filesystem::permissions(workers.path() / name, std::filesystem::perms::owner_all);
  }
  TetOptions tets;
  tets.workers = workers.path();
  const SurfaceMesh ball = make_shape("ball", 162);
  NodeReport report;
  place_nodes(cut_surface(ball, longest_edges(ball) / 2, 642), {}, true, &report, tets);
  EXPECT_TRUE(report.is_mesher_instead);
  EXPECT_EQ(report.tets.mesher, "tetgen");
  EXPECT_EQ(report.tets.failures, (std::vector<std::string>{"gmsh, Delaunay: status 1", "tetgen: status 1"}));
}

TEST(BuildNetwork, NodesThatWereAskedForAreNotGivenUp) {
  TetOptions tets;
  tets.workers = "/nowhere";
  NetworkOptions many;
  many.k = 20;
  try {
    place_nodes(make_shape("ball", 42), many, true, nullptr, tets);
    FAIL() << "filled without a mesher";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("network.sampling = 'mesher' lets the mesher choose them"),
              std::string::npos)
        << error.what();
  }
}

TEST(BuildNetwork, SpacingSetsTheDensityInside) {
  // where no layer is thin and no edge grows, nodes are as one over spacing cubed
  const SurfaceMesh surface = make_shape("ball", 642);
  NetworkOptions coarse, fine;
  coarse.sampling = fine.sampling = "mesher";
  coarse.spacing = 0.8;
  fine.spacing = 0.4;
  const auto inner = [&](const NetworkOptions& options) {
    const SpringNetwork network = build_network(surface, options, true, true);
    return static_cast<double>(network.X.cols() - network.n_surface);
  };
  EXPECT_GT(inner(fine), 2.5 * inner(coarse));
}

TEST(BuildNetwork, RefusesConnectivityThatLosesCorners) {
  NetworkOptions options;
  options.connectivity = "central";
  EXPECT_THROW(build_network(make_shape("ball", 162), options, true, true), std::runtime_error);
}

TEST(BuildNetwork, FollowsTheScenesTable) {
  const SurfaceMesh ball = make_shape("ball", 162);
  NetworkOptions options;
  options.k = 50;
  options.connectivity = "complete";
  EXPECT_EQ(build_network(ball, options, true, false).E.cols(), 212 * 211 / 2);
  options.connectivity = "pcp";
  const SpringNetwork darts = build_network(ball, options, true, false);
  options.sampling = "relaxed";
  EXPECT_NE(build_network(ball, options, true, false).X, darts.X);
  options.sampling = "random";
  EXPECT_THROW(build_network(ball, options, true, false), std::runtime_error);
}

TEST(BuildNetwork, KeepsTheTablesDistancesBetweenNodesAndFromTheSurface) {
  const SurfaceMesh ball = make_shape("ball", 162);
  for (const auto& [phi, psi] : {std::pair(0.2, 0.05), {0.05, 0.2}}) {
    NetworkOptions options;
    options.phi = phi;
    options.psi = psi;
    NodeReport report;
    place_nodes(ball, options, false, &report);
    EXPECT_EQ(report.samples.phi, phi);
    EXPECT_EQ(report.samples.psi, psi);
  }
}

TEST(BuildNetwork, CompletedPcpHasAsManyNeighboursAsTheTableSays) {
  const SurfaceMesh ball = make_shape("ball", 162);  // nearly convex: every link from an inner node is inside
  const auto fewest = [&](int neighbours) {
    NetworkOptions options;
    options.connectivity = "completed_pcp";
    options.k = 150;
    options.neighbours = neighbours;
    const SpringNetwork network = build_network(ball, options, true, false);
    Eigen::VectorXi n_springs = Eigen::VectorXi::Zero(network.X.cols());
    for (int v : network.E.reshaped()) ++n_springs[v];
    return n_springs.tail(network.X.cols() - network.n_surface).minCoeff();
  };
  EXPECT_LT(fewest(8), 14);
  EXPECT_GE(fewest(14), 14);
}

TEST(VertexSpacing, IsTheMeanLengthOfAVertexsEdges) {
  const SurfaceMesh cube = make_shape("bar", 8, {2, 2, 2});
  const Eigen::VectorXd spacing = vertex_spacing(cube);
  for (int v = 0; v < 8; ++v) {
    // diagonals join the corners with an even sum of coordinates
    const bool is_even = static_cast<int>(cube.X.col(v).sum() / 2) % 2 == 0;
    EXPECT_NEAR(spacing[v], is_even ? 1 + std::sqrt(2.0) : 2, 1e-12) << cube.X.col(v).transpose();
  }
}

TEST(InteriorSize, IsPartOfTheSpacingLessInThinBodiesAndNeverTiny) {
  constexpr double kRounding = 1e-12;
  struct Middle {
    double size, spacing;
  };
  const auto at_the_middle = [](double thickness) {
    const SurfaceMesh plate = make_shape("bar", 400, {2, 2, thickness});
    int middle;
    (plate.X.colwise() - Eigen::Vector3d(1, 1, thickness)).colwise().norm().minCoeff(&middle);
    return Middle{interior_size(plate, 0.7)[middle], vertex_spacing(plate)[middle]};
  };
  const Middle thick = at_the_middle(2), thin = at_the_middle(0.001), between = at_the_middle(0.3);
  EXPECT_NEAR(thick.size, 0.7 * thick.spacing, kRounding);
  EXPECT_NEAR(thin.size, 0.35 * thin.spacing, kRounding);
  ASSERT_GT(0.69 * between.spacing, 0.3 / 4);
  ASSERT_LT(0.36 * between.spacing, 0.3 / 4);
  EXPECT_LE(between.size, 0.3 / 4 + kRounding) << "four layers fit";
  EXPECT_GT(between.size, 0.3 / 4 - 0.35 / 32 * between.spacing) << "found by halving five times";
}

TEST(BuildNetwork, StandsOnACutSurface) {
  const SurfaceMesh sheet = make_shape("bar", 100, {4, 4, 0.4}), cut = cut_across(sheet, 2).surface;
  const SpringNetwork as_it_is = build_network(sheet, {}, false, true);
  for (const bool has_links : {false, true}) {
    const SpringNetwork network = build_network(cut, {}, has_links, true);
    EXPECT_EQ(network.n_surface, cut.X.cols());
    EXPECT_EQ(network.cuts.F, sheet.F);
    EXPECT_EQ(network.cuts.between, cut.cuts.between);
    EXPECT_NO_THROW(check_tetrahedra({network.X, network.T, network.F, network.n_surface}, cut));
    const Eigen::Vector3d x(0.3, 0.2, 0);
    EXPECT_GT(n_tetrahedra_along(network, x, 2), n_tetrahedra_along(as_it_is, x, 2));
  }
}
