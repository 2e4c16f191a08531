#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <vector>

#include "meshing/surface_energies/barrier.h"
#include "meshing/surface_energies/surface_points.h"
#include "tests/massspring/small_network.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using massspring::random_points;

/// Places of a symmetric rule, and a corner and the middle of an edge.
Matrix3Xd some_places() {
  Matrix3Xd places(3, 5);
  places << 2. / 3, 1. / 6, 1. / 6, 1, 0,  //
      1. / 6, 2. / 3, 1. / 6, 0, 0.5,      //
      1. / 6, 1. / 6, 2. / 3, 0, 0.5;
  return places;
}

/// Two triangles with a common edge, straight or curved.
Eigen::MatrixXi two_faces(int n) {
  Eigen::MatrixXi faces(6, 2);
  faces << 0, 2, 1, 1, 2, 3, 4, 5, 5, 7, 6, 8;
  return faces.topRows(n);
}

int n_nodes(int n) {
  return n == 3 ? 4 : 9;
}

/// Their nodes at rest.
Matrix3Xd unit_square(int n) {
  Matrix3Xd x(3, 9);
  x << 0, 1, 0, 1, .5, .5, 0, 1, .5,  //
      0, 0, 1, 1, 0, .5, .5, .5, 1,   //
      0, 0, 0, 0, 0, 0, 0, 0, 0;
  return x.leftCols(n_nodes(n));
}

TEST(SurfacePoints, LieWhereALinearOrQuadraticFieldIs) {
  const auto quadratic = [](const Vector3d& l) { return Vector3d(l(0) * l(1), l(1) * l(1) + l(2), l(0)); };
  const auto linear = [](const Vector3d& l) { return Vector3d(2 * l(0) - l(1), l(2), 1); };
  Matrix3Xd corners(3, 6);  // and middles, in barycentric coordinates
  corners << 1, 0, 0, .5, 0, .5, 0, 1, 0, .5, .5, 0, 0, 0, 1, 0, .5, .5;
  for (const int n : {3, 6}) {
    Matrix3Xd x(3, n);
    const auto field = [&](const Vector3d& l) -> Vector3d { return n == 3 ? linear(l) : quadratic(l); };
    for (int a = 0; a < n; ++a) x.col(a) = field(corners.col(a));
    const Matrix3Xd places = some_places();
    const SurfacePoints W = points_on(Eigen::VectorXi::LinSpaced(n, 0, n - 1), places, n);
    const Matrix3Xd points = x * W.transpose();
    for (int k = 0; k < places.cols(); ++k)
      EXPECT_LT((points.col(k) - field(places.col(k))).norm(), 1e-15) << n << ' ' << k;
  }
}

TEST(SurfacePoints, HessianAtNodesIsThatAtPointsBetweenTheMapAndItsTranspose) {
  for (const int n : {3, 6}) {
    const SurfacePoints W = points_on(two_faces(n), some_places(), n_nodes(n));
    const int m = static_cast<int>(W.rows());
    SurfaceHessian H;
    for (int p = 0; p < m; ++p) {
      const Matrix3d B = random_points(3, 1, p);
      H.diagonal.emplace_back(B * B.transpose());
    }
    H.pairs.push_back({{0, 1, 6, 7}, {1, -0.2, -0.5, -0.3}, Vector3d(1, 2, 2) / 3, 7});
    H.blocks.push_back({2, 2, H.diagonal[0]});
    H.blocks.push_back({1, 8, random_points(3, 1, 20)});
    H.roots.push_back(random_points(m - 2, 1, 21));
    const Eigen::Matrix3Xi F = (Eigen::Matrix3Xi(3, 2) << 0, 3, 4, 4, 8, 9).finished();
    H.curvatures.push_back({0.7, &F, random_points(m, 1, 22)});
    const Matrix3Xd p = random_points(n_nodes(n), 1, 23), at_points = p * W.transpose();
    Matrix3Xd expected = Matrix3Xd::Zero(3, m), y = Matrix3Xd::Zero(3, n_nodes(n));
    H.add_sparse_product(at_points, expected);
    expected.leftCols(m - 2) += H.roots[0].cwiseProduct(at_points.leftCols(m - 2)).sum() * H.roots[0];
    for (const auto& t : F.colwise()) {  // of the parts of the volume themselves: the surface is not closed
      const EnclosedVolume v = enclosed_volume(H.curvatures[0].x(Eigen::all, t));
      expected(Eigen::all, t) += 0.7 * (v.hessian * at_points(Eigen::all, t).reshaped()).reshaped(3, 3);
    }
    at_nodes(H, W).add_product(p, y);
    ASSERT_GT(y.norm(), 1);
    EXPECT_LT((y - expected * W).norm(), 1e-14 * y.norm()) << n;
  }
}

/// Areas that points stand for (m2).
Eigen::VectorXd weights_of(const ContactPoints& points) {
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(points.W.rows());
  for (const ContactPoints::Share& share : points.shares) weights(share.point) += share.area;
  return weights;
}

TEST(ContactPoints, IntegrateCubicPolynomialsAndAreSharedByFaces) {
  for (const int n : {3, 6}) {
    const Eigen::MatrixXi faces = two_faces(n);
    const Matrix3Xd X = unit_square(n);
    const std::vector<char> is_constrained(X.cols(), false);
    const ContactPoints points = contact_points(faces, X, is_constrained);
    ASSERT_EQ(points.W.rows(), 4 + 5 + 2);
    const Matrix3Xd at = X * points.W.transpose();
    const Eigen::VectorXd weights = weights_of(points);
    for (int i = 0; i <= 3; ++i)
      for (int j = 0; i + j <= 3; ++j) {
        double sum = 0;
        for (int q = 0; q < at.cols(); ++q) sum += weights(q) * std::pow(at(0, q), i) * std::pow(at(1, q), j);
        EXPECT_NEAR(sum, 1. / ((i + 1) * (j + 1)), 1e-14) << i << ' ' << j;
      }
  }
}

TEST(ContactPoints, GiveAUniformPressureToMiddlesOfCurvedFacesAndInThirdsToCornersOfStraightOnes) {
  const auto forces = [](int n) -> Eigen::VectorXd {
    const ContactPoints points =
        contact_points(two_faces(n).leftCols(1), unit_square(n), std::vector<char>(n_nodes(n), false));
    return points.W.transpose() * weights_of(points);
  };
  EXPECT_LT((forces(3).head<3>().array() - 0.5 / 3).matrix().norm(), 1e-15);
  const Eigen::VectorXd curved = forces(6);
  EXPECT_LT(curved.head<4>().norm(), 1e-15);
  EXPECT_LT((curved({4, 5, 6}).array() - 0.5 / 3).matrix().norm(), 1e-15);
}

TEST(ContactPoints, HangOnNothingThatOnlySupportsMove) {
  std::vector<char> is_constrained(4, false);
  is_constrained[0] = is_constrained[1] = true;  // the edge of the first face alone
  const ContactPoints points = contact_points(two_faces(3), unit_square(3), is_constrained);
  EXPECT_EQ(points.W.rows(), 11 - 3);
  is_constrained.assign(4, true);
  EXPECT_EQ(contact_points(two_faces(3), unit_square(3), is_constrained).W.rows(), 0);
}

/// Faces the other way round.
Eigen::MatrixXi downward(const Eigen::MatrixXi& faces) {
  const std::vector<int> rows =
      faces.rows() == 3 ? std::vector<int>{0, 2, 1} : std::vector<int>{0, 2, 1, 5, 4, 3};
  return faces(rows, Eigen::all);
}

/// Faces some way above a plane with friction, with a barrier at points on them.
struct AboveAPlane {
  std::vector<RigidBody> bodies;
  Matrix3Xd x;
  std::shared_ptr<SurfaceEnergy> energy;
  static constexpr double kRange = 1e-3 * M_SQRT2;

  explicit AboveAPlane(int n) {
    Obstacle plane;
    plane.shape = HalfSpace{{0, 0, 0}, {0, 0, 1}};
    plane.friction = 0.4;
    bodies.emplace_back(plane);
    x = unit_square(n);
    energy = barrier_around(bodies, x, downward(two_faces(n)), 1e5, std::vector<char>(x.cols(), false));
    x.row(2).array() += 0.5 * kRange;
    x.row(2) += 0.2 * kRange * random_points(static_cast<int>(x.cols()), 1, 4).row(0);
    x.row(2) -= 0.1 * kRange * x.row(0);  // no two points lie alike
  }
};

TEST(EnergyOfPoints, ForcesOfABarrierAndItsHessianAreDifferencesOnStraightAndCurvedFaces) {
  for (const int n : {3, 6}) {
    AboveAPlane above(n);
    above.energy->begin_step(0, 1e-2, above.x);
    Matrix3Xd x = above.x;
    x.row(0).array() += 1e-6;  // friction is smoothed up to 1.4e-6 m
    x.row(1).array() -= 5e-7;
    const Matrix3Xd p = random_points(static_cast<int>(x.cols()), 1, 6);
    const auto forces = [&](const Matrix3Xd& at) {
      Matrix3Xd f = Matrix3Xd::Zero(3, at.cols());
      above.energy->add_forces(at, f);
      return f;
    };
    above.energy->follow(x, x);  // the friction of x itself
    const double step = 1e-9;
    const Matrix3Xd f = forces(x), up = x + step * p, down = x - step * p;
    ASSERT_GT(f.row(0).norm(), 1);
    ASSERT_GT(f.row(2).norm(), 1);
    EXPECT_NEAR(f.cwiseProduct(p).sum(), (above.energy->energy(down) - above.energy->energy(up)) / (2 * step),
                1e-4 * f.norm());
    SurfaceHessian H;
    above.energy->add_hessian(x, H, Curvature::Projected);
    Matrix3Xd Kp = Matrix3Xd::Zero(3, x.cols());
    H.add_product(p, Kp);
    EXPECT_LT((Kp - (forces(down) - forces(up)) / (2 * step)).norm(), 1e-4 * Kp.norm());
  }
}

TEST(Barrier, TellsWhatEachObstacleExerts) {
  for (const int n : {3, 6}) {
    AboveAPlane above(n);
    Obstacle far;
    far.shape = Ball{{0, 0, 9}, 1};
    above.bodies.emplace_back(far);
    const auto energy = barrier_around(above.bodies, above.x, downward(two_faces(n)), 1e5,
                                       std::vector<char>(above.x.cols(), false));
    energy->begin_step(0, 1e-2, above.x);
    Matrix3Xd x = above.x, f = Matrix3Xd::Zero(3, x.cols());
    x.row(0).array() += 1e-5;
    energy->add_forces(x, f);
    ASSERT_LT(f.row(0).sum(), -1) << "friction";
    const Eigen::Matrix3d frame = Eigen::AngleAxisd(0.3, Vector3d(1, 2, 2) / 3).matrix();
    const auto columns = contact_columns({energy}, x, frame);
    ASSERT_EQ(columns.size(), 8u);
    const Vector3d sum = frame * f.rowwise().sum();
    for (int c = 0; c < 3; ++c) {
      EXPECT_EQ(columns[c].first, std::string("obstacle_0_force_") + "xyz"[c]);
      EXPECT_NEAR(columns[c].second, sum(c), 1e-12 * sum.norm());
      EXPECT_EQ(columns[4 + c].second, 0);
    }
    EXPECT_EQ(columns[3].first, "obstacle_0_area");
    EXPECT_NEAR(columns[3].second, 1, 1e-4);  // faces lean a little
    EXPECT_EQ(columns[7].second, 0);
  }
}

// The pressure at a gap hangs on its share of the range alone.
TEST(Barrier, ARangeOfItsOwnStretchesTheLawOfPressure) {
  const Eigen::MatrixXi faces = downward(two_faces(3));
  Eigen::Vector2d forces;
  for (const double times : {1., 3.}) {
    Obstacle plane;
    plane.shape = HalfSpace{{0, 0, 0}, {0, 0, 1}};
    plane.range = times * AboveAPlane::kRange;
    Matrix3Xd x = unit_square(3);
    x.row(2).setConstant(0.3 * *plane.range);
    const auto energy = barrier_around({RigidBody(plane)}, x, faces, 1e5, std::vector<char>(x.cols(), false));
    forces(times > 1) = energy->contacts(x)[0].force(2);
    x.row(2).setConstant(*plane.range);
    EXPECT_EQ(energy->energy(x), 0);
  }
  EXPECT_GT(forces(0), 1);
  EXPECT_NEAR(forces(1), forces(0), 1e-12 * forces(0));
}

TEST(EnergyOfPoints, StepsEndBeforeAPointWouldPassAndGuessesAreKeptOut) {
  for (const int n : {3, 6}) {
    AboveAPlane above(n);
    above.energy->begin_step(0, 1e-2, above.x);
    Matrix3Xd dx = Matrix3Xd::Zero(3, above.x.cols());
    dx.row(2).setConstant(-1);
    const double part = above.energy->largest_step(above.x, dx);
    EXPECT_GT(part, 0);
    EXPECT_TRUE(std::isfinite(above.energy->energy(above.x + part * dx)));
    EXPECT_TRUE(std::isinf(above.energy->energy(above.x + 2 * part * dx)));
    Matrix3Xd y = above.x;
    y.row(2).array() -= 3 * AboveAPlane::kRange;
    ASSERT_TRUE(std::isinf(above.energy->energy(y)));
    EXPECT_TRUE(above.energy->keep_out(above.x, y));
    EXPECT_TRUE(std::isfinite(above.energy->energy(y)));
    EXPECT_LT((y - above.x).row(2).maxCoeff(), 3 * AboveAPlane::kRange);
    EXPECT_LT((y - above.x).topRows<2>().norm(), 1e-15);
    Matrix3Xd far = above.x;
    far.row(2).array() += 1;
    EXPECT_FALSE(above.energy->keep_out(above.x, far));
  }
}

// Two faces at right angles, one of them on the plane: the other's part of their edge does not press.
TEST(BarrierAround, CountsFacesByHowFarTheyFaceABody) {
  constexpr double kGap = 5e-4;
  Obstacle plane;
  plane.shape = HalfSpace{{0, 0, -kGap}, {0, 0, 1}};
  const std::vector<RigidBody> bodies{RigidBody(plane)};
  Matrix3Xd X(3, 4);
  X << 0, 1, 0, 0,  //
      0, 0, 1, 0,   //
      0, 0, 0, 1;
  const auto force = [&](const Eigen::MatrixXi& faces, double angle) {
    const Matrix3Xd x = Eigen::AngleAxisd(angle, Vector3d::UnitX()).matrix() * X;
    const auto energy = barrier_around(bodies, X, faces, 1e5, std::vector<char>(4, false));
    energy->begin_step(0, 1, x);
    Matrix3Xd f = Matrix3Xd::Zero(3, 4);
    energy->add_forces(x, f);
    return f(2, 0) + f(2, 1);  // of the edge about which it is turned
  };
  const Eigen::MatrixXi lower = Eigen::Vector3i(0, 2, 1);
  const Eigen::MatrixXi both = (Eigen::MatrixXi(3, 2) << 0, 0, 2, 1, 1, 3).finished();
  const double alone = force(lower, 0);
  EXPECT_GT(alone, 0);
  EXPECT_NEAR(force(both, 0), alone, 2e-3 * alone);
  EXPECT_GT(force(both, 0), (1 + 1e-4) * alone) << "nothing passes";
  const double at_45 = force(both, M_PI / 4);
  // Corners and middle of the edge alone, of what goes to two of three corners of a face.
  EXPECT_NEAR(at_45, std::sqrt(0.5) * 2 * (1. / 10 + 2. / 15) / (2. / 3) * alone, 1e-6 * alone);
}

TEST(EnergyOfPoints, IsAsItsEnergyInWhatAStepAsksFirst) {
  const AboveAPlane above(3);
  EXPECT_TRUE(above.energy->bounds_steps());
  EXPECT_TRUE(above.energy->is_stiff());
  EXPECT_FALSE(above.energy->is_invariant());
}

}  // namespace
}  // namespace testbed::meshing
