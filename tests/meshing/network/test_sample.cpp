#include <gtest/gtest.h>

#include "meshing/base/random.h"
#include "meshing/network/network.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface/surface_tree.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

SampleOptions options_of(double phi, double psi, std::optional<int> k = {}) {
  SampleOptions options;
  options.phi = phi;
  options.psi = psi;
  options.k = k;
  return options;
}

double smallest_distance(const Eigen::Matrix3Xd& X) {
  double smallest = 1e300;
  for (int i = 0; i < X.cols(); ++i)
    for (int j = 0; j < i; ++j) smallest = std::min(smallest, (X.col(i) - X.col(j)).norm());
  return smallest;
}

}  // namespace

TEST(Random, IsSplitMix64) {
  Random random(1234567);  // the generator's published sequence
  for (std::uint64_t expected : {6457827717110365317u, 3203168211198807973u, 9817491932198370423u,
                                 4593380528125082431u, 16408922859458223821u})
    EXPECT_EQ(random.bits(), expected);
}

TEST(FillSpacing, IsTheMeanEdgeOrLessInThinBodiesAndHalfOfThat) {
  constexpr double kRounding = 1e-12;
  // A cube of side 2 in n x n cells a side: of its edges two thirds are 2/n long, a third is a diagonal.
  const auto mean_edge = [](int n) { return (2 + std::sqrt(2.0)) / 3 * 2 / n; };
  const double thickness = 8.0 / 24;  // volume over area
  const SampleOptions coarse = fill_spacing(make_shape("bar", 8, {2, 2, 2}), {});
  ASSERT_GT(mean_edge(1), thickness);
  EXPECT_NEAR(*coarse.phi, thickness / 2, kRounding);
  EXPECT_NEAR(*coarse.psi, thickness / 4, kRounding);
  const SurfaceMesh many = make_shape("bar", 6 * 100 + 2, {2, 2, 2});
  ASSERT_LT(mean_edge(10), thickness);
  const SampleOptions fine = fill_spacing(many, {});
  EXPECT_NEAR(*fine.phi, mean_edge(10) / 2, kRounding);
  EXPECT_NEAR(*fine.psi, mean_edge(10) / 4, kRounding);
  const SampleOptions given = fill_spacing(many, options_of(0.3, 0.4));
  EXPECT_EQ(*given.phi, 0.3);
  EXPECT_EQ(*given.psi, 0.4);
}

TEST(SampleInterior, NodesPassTheThreeTestsOfFigure4) {
  const SurfaceMesh ball = make_shape("ball", 162);
  const SurfaceMesh hollow = join(ball, inside_out(scaled(ball, 0.4)));
  for (const SurfaceMesh& surface : {make_shape("torus", 924), make_shape("handle", 932), hollow}) {
    const double side = (surface.X.rowwise().maxCoeff() - surface.X.rowwise().minCoeff()).minCoeff();
    const Eigen::Matrix3Xd X = sample_interior(surface, options_of(0.15, 0.1));
    const SurfaceTree tree(surface);
    ASSERT_GT(X.cols(), 30);
    EXPECT_GE(smallest_distance(X), 0.15 * side);
    for (const auto& x : X.colwise()) EXPECT_GE(tree.depth(x), 0.1 * side);
  }
}

TEST(SampleInterior, ReturnsWhatIsWantedOrWhatFits) {
  const SurfaceMesh ball = make_shape("ball", 162);
  EXPECT_EQ(sample_interior(ball, options_of(0.05, 0.05, 500)).cols(), 500);
  EXPECT_EQ(sample_interior(ball, options_of(0.05, 0.05, 0)).cols(), 0);
  const auto few = sample_interior(ball, options_of(0.3, 0.05, 100000)).cols();
  EXPECT_GT(few, 10);
  EXPECT_LT(few, 200);
  EXPECT_EQ(sample_interior(ball, options_of(0.1, 0.6)).cols(), 0);  // psi beyond the radius
}

TEST(SampleInterior, AThinMatTakesNoMoreThanThreeNodesForEachOfTheSurface) {
  const SurfaceMesh mat = make_shape("bar", 400, {1, 1, 0.02});
  SampleReport report;
  const Eigen::Matrix3Xd bounded = sample_interior(mat, {}, &report);
  const Eigen::Index most = 3 * mat.X.cols();
  EXPECT_LE(bounded.cols(), most);
  EXPECT_GT(bounded.cols(), most / 2) << "the least distance that they allow, but for a tenth";
  ASSERT_TRUE(report.most_nodes);
  EXPECT_EQ(*report.most_nodes, most);
  EXPECT_GE(smallest_distance(bounded), report.phi * 0.02);
  EXPECT_GT(report.phi, 1.1 * *fill_spacing(mat, {}).phi) << "what was taken, not what fits the surface";
  EXPECT_EQ(report.psi, *fill_spacing(mat, {}).psi);

  // who asks for more gets it
  const double phi = *fill_spacing(mat, {}).phi;
  EXPECT_GT(sample_interior(mat, options_of(phi, report.psi), &report).cols(), 2 * most);
  EXPECT_FALSE(report.most_nodes);
  SampleOptions wanted;
  wanted.k = static_cast<int>(2 * most);
  EXPECT_EQ(sample_interior(mat, wanted, &report).cols(), 2 * most);
  EXPECT_FALSE(report.most_nodes);
}

TEST(SampleInterior, ABallIsFilledToTheSurfacesSpacing) {
  const SurfaceMesh ball = make_shape("ball", 642);
  const SampleOptions filled = fill_spacing(ball, {});
  SampleReport report;
  EXPECT_EQ(sample_interior(ball, {}, &report), sample_interior(ball, options_of(*filled.phi, *filled.psi)));
  EXPECT_FALSE(report.most_nodes);
  EXPECT_NEAR(report.phi, *filled.phi, 1e-15);
}

TEST(SampleInterior, FillsTheBody) {
  // Saturated dart throwing has 0.73 nodes per phi^3; giving a cell up after 30 misses stops a tenth short of
  // it. phi^3.
  const SurfaceMesh ball = make_shape("ball", 642);
  const double phi = 0.05, side = 2, psi = 0.01;
  const double free_volume = 4 * 3.14159265 / 3 * std::pow(1 - psi * side, 3);
  const double density =
      sample_interior(ball, options_of(phi, psi)).cols() * std::pow(phi * side, 3) / free_volume;
  EXPECT_GT(density, 0.60);
  EXPECT_LT(density, 0.75);
}

TEST(SampleInterior, IsUniform) {
  const SurfaceMesh ball = make_shape("ball", 642);
  const Eigen::Matrix3Xd X = sample_interior(ball, options_of(0.02, 0.0, 4000));
  // 4000 nodes: the mean of a coordinate scatters by sqrt(1/5)/sqrt(4000) = 0.007, taken five times
  EXPECT_LT(X.rowwise().mean().cwiseAbs().maxCoeff(), 0.035);
  EXPECT_NEAR((X.colwise().norm().array() < 0.5).count() / 4000.0, 0.125, 5 * std::sqrt(0.125 / 4000));
}

TEST(SampleInterior, SameSeedSameNodesOtherSeedOthers) {
  const SurfaceMesh ball = make_shape("ball", 162);
  SampleOptions options = options_of(0.1, 0.05, 100);
  const Eigen::Matrix3Xd first = sample_interior(ball, options);
  EXPECT_EQ(sample_interior(ball, options), first);
  options.seed = 2;
  EXPECT_NE(sample_interior(ball, options), first);
}

TEST(SampleInterior, ChoosesSpacingForThickAndThinBodies) {
  for (const SurfaceMesh& surface :
       {make_shape("ball", 642), make_shape("bar", 500, {1, 1, 0.02}), make_shape("torus", 80)})
    EXPECT_GT(sample_interior(surface, {}).cols(), 20);
}

TEST(SampleInterior, RefusesOptionsOutOfRange) {
  const SurfaceMesh ball = make_shape("ball", 162);
  EXPECT_THROW(sample_interior(ball, options_of(0, 0.1)), std::runtime_error);
  EXPECT_THROW(sample_interior(ball, options_of(0.1, -0.1)), std::runtime_error);
  EXPECT_THROW(sample_interior(ball, options_of(0.1, 0.1, -1)), std::runtime_error);
  EXPECT_THROW(sample_interior(ball, options_of(1e-5, 0.1)), std::runtime_error);
}

TEST(SampleInterior, GradedNodesAreDenseWhereTheSurfaceIs) {
  SurfaceMesh ball = make_shape("ball", 642);  // edges at its top a third as long as at its bottom
  ball.X = (ball.X.colwise() + Eigen::Vector3d(0, 0, 0.5)).colwise().normalized();
  SampleOptions options = options_of(0.03, 0.02, 600);
  const auto top_over_bottom = [&](Sampling sampling) {
    options.sampling = sampling;
    const Eigen::Matrix3Xd X = sample_interior(ball, options);
    return static_cast<double>((X.row(2).array() > 0.4).count()) / (X.row(2).array() < -0.4).count();
  };
  EXPECT_NEAR(top_over_bottom(Sampling::Relaxed), 1, 0.3);
  // Where edges are everywhere a share of the spacing at the nearest vertex, nodes are as 1 / spacing^3.
  const Eigen::VectorXd spacing = vertex_areas(ball.X, ball.F).cwiseSqrt();
  const SurfaceTree tree(ball);
  Random random(5);
  double top = 0, bottom = 0;
  for (int trial = 0; trial < 20000; ++trial) {
    const Eigen::Vector3d x = Eigen::Vector3d::NullaryExpr([&] { return 2 * random.uniform() - 1; });
    if (x.norm() > 0.95 || std::abs(x.z()) < 0.4) continue;
    int nearest;
    (ball.X.colwise() - x).colwise().squaredNorm().minCoeff(&nearest);
    (x.z() > 0 ? top : bottom) += std::pow(spacing(nearest), -3);
  }
  ASSERT_GT(top / bottom, 10);
  const double found = top_over_bottom(Sampling::Graded);
  EXPECT_NEAR(found / (top / bottom), 1, 0.35) << "but for the layers below the surface";
}

TEST(SampleInterior, RelaxedNodesLieMoreEvenlyAndDeepEnough) {
  const SurfaceMesh ball = make_shape("ball", 642);
  SampleOptions options = options_of(0.03, 0.05, 400);
  const Eigen::Matrix3Xd darts = sample_interior(ball, options);
  options.sampling = Sampling::Relaxed;
  const Eigen::Matrix3Xd relaxed = sample_interior(ball, options);
  ASSERT_EQ(relaxed.cols(), darts.cols());
  EXPECT_GT(smallest_distance(relaxed), 1.5 * smallest_distance(darts));
  const SurfaceTree tree(ball);
  for (const auto& x : relaxed.colwise()) EXPECT_GE(tree.depth(x), 0.05 * 2);
  EXPECT_EQ(sample_interior(ball, options), relaxed);
}
