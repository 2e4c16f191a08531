#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <filesystem>
#include <set>

#include "meshing/base/random.h"
#include "meshing/network/connect.h"
#include "meshing/network/delaunay.h"
#include "meshing/network/rigidity.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/shells.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_io.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

SpringNetwork network_of(const SurfaceMesh& surface, Connectivity connectivity, int k = 150) {
  SampleOptions sample;
  sample.k = k;
  ConnectOptions options;
  options.connectivity = connectivity;
  return connect(surface, sample_interior(surface, sample), options);
}

/// Zero eigenvalues of the dense stiffness matrix of unit springs.
int count_zero_modes(const SpringNetwork& network) {
  Eigen::MatrixXd R = Eigen::MatrixXd::Zero(network.E.cols(), 3 * network.X.cols());
  for (int s = 0; s < network.E.cols(); ++s) {
    const int i = network.E(0, s), j = network.E(1, s);
    const Eigen::RowVector3d d = (network.X.col(j) - network.X.col(i)).normalized();
    R.block<1, 3>(s, 3 * i) = -d;
    R.block<1, 3>(s, 3 * j) = d;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(R.transpose() * R, Eigen::EigenvaluesOnly);
  return static_cast<int>((solver.eigenvalues().array() < 1e-6).count());
}

int count_outside(const SpringNetwork& network, const SurfaceMesh& surface) {
  const SurfaceTree tree(surface);
  int n_outside = 0;
  for (int s = static_cast<int>(edges_of(surface.F).cols()); s < network.E.cols(); ++s)
    n_outside += !is_inside(tree, network.X, network.n_surface, network.E(0, s), network.E(1, s));
  return n_outside;
}

}  // namespace

TEST(Connect, EveryWayPutsTheSurfacesEdgesFirstAndNoPairTwice) {
  const SurfaceMesh surface = make_shape("torus", 200);
  const Eigen::Matrix2Xi edges = edges_of(surface.F);
  for (const std::string& name : all_names<Connectivity>()) {
    const SpringNetwork network = network_of(surface, connectivity_of(name));
    EXPECT_EQ(network.E.leftCols(edges.cols()), edges) << name;
    EXPECT_EQ(network.X.leftCols(200), surface.X) << name;
    std::set<std::pair<int, int>> pairs;
    for (const auto& e : network.E.colwise()) {
      EXPECT_LT(e[0], e[1]) << name;
      pairs.emplace(e[0], e[1]);
    }
    EXPECT_EQ(pairs.size(), static_cast<size_t>(network.E.cols())) << name;
  }
}

TEST(Connect, CountsFollowFromTheWay) {
  const SurfaceMesh ball = make_shape("ball", 162);
  EXPECT_EQ(network_of(ball, Connectivity::Surface).E.cols(), 480);
  EXPECT_EQ(network_of(ball, Connectivity::Central).E.cols(), 480 + 162);
  const SpringNetwork complete = network_of(ball, Connectivity::Complete);
  EXPECT_EQ(complete.E.cols(), complete.X.cols() * (complete.X.cols() - 1) / 2);
  EXPECT_THROW(network_of(make_shape("ball", 10242), Connectivity::Complete), std::runtime_error);
  EXPECT_THROW(connectivity_of("pcq"), std::runtime_error);
}

TEST(Connect, NoPairIsTwiceWhateverTheOrderOfTheVertices) {
  // The farthest vertices come first, so that many links of vertex 0 precede its first edge.
  for (int n : {12, 42, 162}) {
    const SurfaceMesh ball = make_shape("ball", n);
    SurfaceMesh surface = ball;
    for (int v = 1; v < n; ++v) surface.X.col(v) = ball.X.col(n - v);
    for (int& v : surface.F.reshaped()) v = v == 0 ? 0 : n - v;
    ASSERT_GT(edges_of(surface.F)(1, 0), 4);
    ConnectOptions options;
    options.connectivity = Connectivity::Complete;
    EXPECT_EQ(connect(surface, Eigen::Matrix3Xd(3, 0), options).E.cols(), n * (n - 1) / 2);
  }
}

TEST(Connect, DelaunayEdgesAreThoseOfEmptySpheres) {
  // the centre of a cube has every corner as a neighbour
  const SurfaceMesh box = make_shape("bar", 8, {1, 1, 1});
  ConnectOptions options;
  options.connectivity = Connectivity::Delaunay;
  const SpringNetwork network = connect(box, Eigen::Vector3d(0.5, 0.5, 0.5), options);
  std::set<int> reached;
  for (const auto& e : network.E.colwise())
    if (e[1] == 8) reached.insert(e[0]);
  EXPECT_EQ(reached.size(), 8u);
}

TEST(Connect, CentralLinksEveryVertexToTheirMean) {
  const SurfaceMesh bar = make_shape("bar", 8, {1, 2, 4});
  const SpringNetwork network = network_of(bar, Connectivity::Central);
  EXPECT_LT((network.X.col(8) - Eigen::Vector3d(0.5, 1, 2)).norm(), 1e-15);
  for (int v = 0; v < 8; ++v) EXPECT_EQ(network.E.col(18 + v), Eigen::Vector2i(v, 8));
}

TEST(DelaunayEdges, AreThoseOfTetrahedraWithNoPointInTheirSphere) {
  Random random(8);
  const Eigen::Matrix3Xd X = Eigen::Matrix3Xd::NullaryExpr(3, 16, [&] { return random.uniform(); });
  std::set<std::pair<int, int>> expected;
  for (int a = 0; a < 16; ++a)
    for (int b = a + 1; b < 16; ++b)
      for (int c = b + 1; c < 16; ++c)
        for (int d = c + 1; d < 16; ++d) {
          Eigen::Matrix3d sides;
          sides << X.col(b) - X.col(a), X.col(c) - X.col(a), X.col(d) - X.col(a);
          const Eigen::Vector3d centre =
              sides.transpose().inverse() * sides.colwise().squaredNorm().transpose() / 2;
          bool is_empty = true;
          for (int p = 0; p < 16; ++p)
            if (p != a && p != b && p != c && p != d)
              is_empty = is_empty && (X.col(p) - X.col(a) - centre).norm() > centre.norm();
          if (is_empty) expected.insert({{a, b}, {a, c}, {a, d}, {b, c}, {b, d}, {c, d}});
        }
  const auto found = delaunay_edges(X);
  EXPECT_EQ(found, (std::vector<std::pair<int, int>>(expected.begin(), expected.end())));
}

TEST(Connect, LinksOfDelaunayAndCompletedPcpStayInTheSolid) {
  SurfaceMesh torus = make_shape("torus", 200);
  Random random(9);  // a little noise, since a link that lies in a flat side is neither in nor out
  torus.X += Eigen::Matrix3Xd::NullaryExpr(3, torus.X.cols(), [&] { return 0.02 * random.uniform(); });
  for (auto way : {Connectivity::Delaunay, Connectivity::CompletedPcp}) {
    const SpringNetwork network = network_of(torus, way, 60);
    const long n_edges = edges_of(torus.F).cols();
    ASSERT_GT(network.E.cols(), n_edges + 100);
    for (long s = n_edges; s < network.E.cols(); ++s)
      for (double part : {0.1, 0.3, 0.5, 0.7, 0.9}) {
        const Eigen::Vector3d a = network.X.col(network.E(0, s)), b = network.X.col(network.E(1, s));
        EXPECT_GT(winding_number(a + part * (b - a), torus.X, torus.F), 0.5) << network.E.col(s).transpose();
      }
  }
}

TEST(Connect, CompletedPcpLinksEveryNodeToItsNearestNeighbours) {
  const SurfaceMesh ball = make_shape("ball", 162);
  SampleOptions sample;
  sample.k = 150;
  const Eigen::Matrix3Xd interior = sample_interior(ball, sample);
  for (int n_neighbours : {8, 12}) {
    ConnectOptions options;
    options.connectivity = Connectivity::CompletedPcp;
    options.neighbours = n_neighbours;
    const SpringNetwork network = connect(ball, interior, options);
    std::set<std::pair<int, int>> links;
    for (const auto& e : network.E.colwise()) links.emplace(e[0], e[1]);
    // A ball is nearly convex: all links from an internal node lie inside.
    for (int i = 162; i < network.X.cols(); ++i) {
      std::vector<std::pair<double, int>> others;
      for (int j = 0; j < network.X.cols(); ++j)
        if (j != i) others.emplace_back((network.X.col(j) - network.X.col(i)).norm(), j);
      std::sort(others.begin(), others.end());
      for (int n = 0; n < n_neighbours; ++n)
        EXPECT_TRUE(links.count(std::minmax(i, others[n].second))) << i << ' ' << n;
    }
  }
}

TEST(Connect, CompletedPcpIsRigidWherePcpIsNot) {
  for (const char* shape : {"ball", "torus", "handle", "head"}) {
    const SurfaceMesh surface = make_shape(shape, 120);
    const SpringNetwork pcp = network_of(surface, Connectivity::Pcp, 60);
    const SpringNetwork completed = network_of(surface, Connectivity::CompletedPcp, 60);
    EXPECT_GT(count_floppy_modes(pcp), 0) << shape;
    EXPECT_EQ(count_floppy_modes(completed), 0) << shape;
    EXPECT_EQ(count_zero_modes(completed), 6) << shape;
    EXPECT_EQ(count_outside(completed, surface), 0) << shape;
  }
}

TEST(Connect, CompletedPcpLeavesNoNodeWeak) {
  for (const char* shape : {"ball", "bar", "torus", "handle"})
    EXPECT_TRUE(weak_nodes(network_of(make_shape(shape, 300), Connectivity::CompletedPcp, 60)).empty())
        << shape;
}

TEST(Connect, CompletedPcpRefusesAVertexThatNoLinkInsideHolds) {
  SurfaceMesh flat{Eigen::Matrix3Xd(3, 4), Eigen::Matrix3Xi(3, 4)};
  flat.X << 0, 1, 0, 0.3,  //
      0, 0, 1, 0.3,        //
      0, 0, 0, 1e-6;
  flat.F << 0, 0, 1, 0,  //
      2, 1, 2, 3,        //
      1, 3, 3, 2;
  ConnectOptions options;
  options.connectivity = Connectivity::CompletedPcp;
  try {
    connect(flat, Eigen::Matrix3Xd(3, 0), options);
    FAIL() << "held across a sheet of no thickness";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("the first, node 3 at ("), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("degrees of a plane"), std::string::npos) << error.what();
  }
}

TEST(Connect, CompletedPcpTiesSeveralSolidsEachForItself) {
  const SurfaceMesh ball = make_shape("ball", 42);
  const SurfaceMesh all = join(join(ball, inside_out(scaled(ball, 0.5))), shifted(ball, {2.3, 0, 0}));
  const SpringNetwork network = network_of(all, Connectivity::CompletedPcp, 60);
  EXPECT_EQ(count_floppy_modes(network), 0);
  EXPECT_EQ(count_zero_modes(network), 12);
  EXPECT_EQ(count_outside(network, all), 0);
}

TEST(Connect, CompletedPcpTakesRealMeshes) {
  for (const char* name : {"spot.ply", "liver2.obj", "handle.off"}) {
    const std::filesystem::path file = std::filesystem::path(MESH_FOLDER) / name;
    if (!std::filesystem::exists(file)) GTEST_SKIP() << "no " << file;
    const SurfaceMesh surface = read_surface(file);
    const SpringNetwork network = network_of(surface, Connectivity::CompletedPcp, 2000);
    EXPECT_EQ(count_outside(network, surface), 0) << name;
    EXPECT_EQ(count_floppy_modes(network), 0) << name;
  }
}

TEST(Rigidity, FloppyModesAreTheZeroEigenvaluesBeyondTheRigidOnes) {
  for (const char* shape : {"ball", "bar"}) {
    const SurfaceMesh surface = make_shape(shape, 100);
    for (auto way :
         {Connectivity::Surface, Connectivity::Central, Connectivity::Pcp, Connectivity::Complete}) {
      const SpringNetwork network = network_of(surface, way, 60);
      EXPECT_EQ(count_floppy_modes(network), count_zero_modes(network) - 6) << shape;
    }
  }
}

TEST(Rigidity, ANodeIsWeakWithFiveSpringsAndNotWithSixInAllDirections) {
  SpringNetwork star{Eigen::Matrix3Xd::Zero(3, 7), {}, Eigen::Matrix2Xi(2, 6), {}, 7};
  for (int v = 1; v < 7; ++v) {
    star.X((v - 1) / 2, v) = v % 2 ? 1 : -2;
    star.E.col(v - 1) << 0, v;
  }
  EXPECT_EQ(weak_nodes(star), (std::vector<int>{1, 2, 3, 4, 5, 6}));
  star.E.conservativeResize(2, 5);
  EXPECT_EQ(weak_nodes(star), (std::vector<int>{0, 1, 2, 3, 4, 5, 6}));
}

TEST(Rigidity, WeakNodesHaveFewSpringsOrAllInAPlane) {
  SpringNetwork network = network_of(make_shape("bar", 300), Connectivity::Surface);
  // on a flat side all springs of a vertex lie in the plane
  const std::vector<int> weak = weak_nodes(network);
  EXPECT_GT(weak.size(), 100u);
  EXPECT_TRUE(weak_nodes(network_of(make_shape("ball", 162), Connectivity::Complete)).empty());
}
