#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <set>

#include "meshing/network/network.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"

using namespace testbed::meshing;

namespace {

struct Network {
  SpringNetwork springs;
  PcpReport report;
  long n_edges;
};

Network network_of(const std::string& shape, int n_vertices, PcpOptions options) {
  const SurfaceMesh surface = make_shape(shape, n_vertices);
  SampleOptions sample;
  sample.phi = 0.05;
  sample.psi = 0.05;
  sample.k = 500;
  Network network;
  network.n_edges = edges_of(surface.F).cols();
  network.springs = link_pcp(surface, sample_interior(surface, sample), options, &network.report);
  return network;
}

/// Figure 8 stage by stage with linear search.
std::vector<std::pair<int, int>> brute_force(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior,
                                             int order) {
  const int n = static_cast<int>(surface.X.cols()), k = static_cast<int>(interior.cols());
  enum Colour { kBlack, kGray, kWhite, kDone };
  std::vector<Colour> colour(n + k, kBlack);
  std::fill_n(colour.begin(), n, kWhite);
  std::vector<int> degree(n + k, 0);
  std::vector<std::pair<int, int>> links;
  Eigen::Matrix3Xd X(3, n + k);
  X << surface.X, interior;
  const Eigen::Matrix2Xi edges = edges_of(surface.F);
  for (int v : edges.reshaped()) ++degree[v];
  int n_black = k;
  while (true) {
    for (int w = 0; w < n + k; ++w) {
      if (colour[w] != kWhite) continue;
      std::vector<std::tuple<double, int, int>> targets;
      for (int b = 0; b < n + k; ++b)
        if (colour[b] == kBlack || colour[b] == kGray)
          targets.emplace_back((X.col(b) - X.col(w)).squaredNorm(), degree[b], b);
      std::sort(targets.begin(), targets.end());
      for (int j = 0; j < std::min<int>(order, targets.size()); ++j) {
        const int b = std::get<2>(targets[j]);
        links.emplace_back(std::min(w, b), std::max(w, b));
        ++degree[w], ++degree[b];
        n_black -= colour[b] == kBlack;
        colour[b] = kGray;
        if (n_black == 0) return links;
      }
    }
    for (Colour& c : colour) c = c == kWhite ? kDone : c == kGray ? kWhite : c;
  }
}

void expect_figure_8(const SurfaceMesh& surface, const Eigen::Matrix3Xd& interior) {
  const Eigen::Matrix2Xi edges = edges_of(surface.F);
  for (int multiplicity : {3, 5, 8}) {
    const SpringNetwork network = link_pcp(surface, interior, {multiplicity, PcpReading::StageWise});
    const auto expected = brute_force(surface, interior, multiplicity);
    ASSERT_EQ(network.E.cols(), edges.cols() + static_cast<long>(expected.size()));
    EXPECT_EQ(network.E.leftCols(edges.cols()), edges);
    for (size_t s = 0; s < expected.size(); ++s)
      EXPECT_EQ(network.E.col(edges.cols() + s), Eigen::Vector2i(expected[s].first, expected[s].second));
  }
}

}  // namespace

TEST(LinkPcp, IsFigure8StageByStage) {
  const SurfaceMesh surface = make_shape("torus", 200);
  SampleOptions sample;
  sample.k = 150;
  sample.phi = sample.psi = 0.08;
  const Eigen::Matrix3Xd interior = sample_interior(surface, sample);
  ASSERT_GT(interior.cols(), 100);
  expect_figure_8(surface, interior);
}

TEST(LinkPcp, EqualDistancesGoByTheFewestSpringsOfTheInnerNode) {
  // grids of powers of two: distances are equal to the last bit
  Eigen::Matrix3Xd grid(3, 7 * 7 * 7);
  for (int i = 0; i < grid.cols(); ++i)
    grid.col(i) = Eigen::Vector3i(1 + i % 7, 1 + i / 7 % 7, 1 + i / 49).cast<double>();
  expect_figure_8(make_shape("bar", 26, {2, 2, 2}), grid / 4);
}

TEST(LinkPcp, KeepsNodesAndLinksNoPairTwice) {
  for (auto reading : {PcpReading::StageWise, PcpReading::WholeLastStage, PcpReading::Literal}) {
    const SpringNetwork network = network_of("head", 932, {5, reading}).springs;
    EXPECT_EQ(network.X.leftCols(932), make_shape("head", 932).X);
    std::set<std::pair<int, int>> pairs;
    std::vector<bool> is_linked(network.X.cols(), false);
    for (const auto& e : network.E.colwise()) {
      EXPECT_LT(e[0], e[1]);
      pairs.emplace(e[0], e[1]);
      is_linked[e[0]] = is_linked[e[1]] = true;
    }
    EXPECT_EQ(pairs.size(), static_cast<size_t>(network.E.cols()));
    EXPECT_EQ(std::count(is_linked.begin(), is_linked.end(), false), 0);
  }
}

TEST(LinkPcp, LiteralReadingLinksEveryInternalNodeOnce) {
  const Network network = network_of("ball", 162, {5, PcpReading::Literal});
  EXPECT_EQ(network.springs.E.cols() - network.n_edges, 500);
}

TEST(LinkPcp, WholeLastStageProjectsFromEveryWhiteNode) {
  const Network early = network_of("ball", 162, {5, PcpReading::StageWise});
  const Network whole = network_of("ball", 162, {5, PcpReading::WholeLastStage});
  EXPECT_GT(whole.report.white_per_stage.back(), early.report.white_per_stage.back());
  EXPECT_GT(whole.springs.E.cols(), early.springs.E.cols());
  EXPECT_EQ(early.springs.E, whole.springs.E.leftCols(early.springs.E.cols()));
}

TEST(LinkPcp, WithoutInternalNodesLeavesTheSurface) {
  const SurfaceMesh ball = make_shape("ball", 42);
  EXPECT_EQ(link_pcp(ball, Eigen::Matrix3Xd(3, 0), {}).E, edges_of(ball.F));
}

TEST(LinkPcp, RefusesAMultiplicityBelowThree) {
  EXPECT_THROW(link_pcp(make_shape("ball", 42), Eigen::Matrix3Xd(3, 0), {2, PcpReading::StageWise}),
               std::runtime_error);
}

TEST(LinkPcp, MeetsTheArithmeticOfTable1) {
  struct Row {
    const char* shape;
    int n_surface, multiplicity, springs_inside;
    double tolerance;  // 3 %, but for the torus
  };
  // How many white nodes the last stage dequeues before the last black node is reached depends on the nodes'
  // order: in a torus of any proportions 320 to 390 of some 440 over seeds, 47 if the inner nodes are
  // shuffled; the paper's has 430. So its count lies between ours and that of a last stage that all white
  // nodes finish. total springs less 3/2 of the faces of a closed surface with these vertices [paper table 1]
  for (const Row& row : {Row{"ball", 162, 5, 3055, 0.03}, Row{"torus", 924, 5, 6770, 0.09},
                         Row{"handle", 932, 3, 4047, 0.03}, Row{"head", 3897, 3, 13123, 0.03}}) {
    const Network network = network_of(row.shape, row.n_surface, {row.multiplicity, PcpReading::StageWise});
    EXPECT_EQ(network.springs.n_surface, row.n_surface);
    EXPECT_EQ(network.springs.X.cols(), row.n_surface + 500) << row.shape;
    const auto& stages = network.report.white_per_stage;
    const int white = std::accumulate(stages.begin(), stages.end(), 0);
    const long inside = network.springs.E.cols() - network.n_edges;
    EXPECT_NEAR(inside / double(row.springs_inside), 1, row.tolerance)
        << row.shape << ": " << inside << " springs, " << white << " white nodes";
    EXPECT_LE(inside, row.multiplicity * white) << row.shape;
    EXPECT_GT(inside, row.multiplicity * white - 2 * row.multiplicity) << row.shape;
    const Network whole =
        network_of(row.shape, row.n_surface, {row.multiplicity, PcpReading::WholeLastStage});
    EXPECT_GT(whole.springs.E.cols() - whole.n_edges, 0.97 * row.springs_inside) << row.shape;
  }
}

// Few nodes and one stage, so that every white node chooses among all: an oracle ranks them one by one.
TEST(Pcp, ProjectsToTheBestOfAWeightedPriority) {
  const SurfaceMesh surface = make_shape("ball", 42);
  SampleOptions where;
  where.k = 60;
  where.phi = where.psi = 0.05;
  const Eigen::Matrix3Xd interior = sample_interior(surface, where);
  const int n_surface = static_cast<int>(surface.X.cols());
  const SurfaceTree tree(surface);
  for (const auto& [by_degree, by_depth] : {std::pair(0.3, 0.), {0., 2.}, {0.1, 1.}}) {
    const SpringNetwork network =
        link_pcp(surface, interior, {4, PcpReading::StageWise, by_degree, by_depth});
    std::vector<int> degree(n_surface + interior.cols(), 0);
    Eigen::Index s = surface.F.cols() * 3 / 2;
    for (int white = 0; white < n_surface; ++white) {
      std::vector<std::pair<double, int>> ranked;
      for (int i = 0; i < interior.cols(); ++i)
        ranked.emplace_back((interior.col(i) - surface.X.col(white)).norm() +
                                by_degree * degree[n_surface + i] + by_depth * tree.depth(interior.col(i)),
                            n_surface + i);
      std::sort(ranked.begin(), ranked.end());
      for (int m = 0; m < 4 && s < network.E.cols(); ++m, ++s) {  // until no node is black
        ASSERT_EQ(network.E.col(s), Eigen::Vector2i(white, ranked[m].second));
        ++degree[ranked[m].second];
      }
    }
    EXPECT_GT(network.E.cols(), surface.F.cols() * 3 / 2 + interior.cols());
  }
}
