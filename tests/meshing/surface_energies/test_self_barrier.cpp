#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <set>

#include "meshing/base/random.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/self_barrier.h"
#include "meshing/surface_energies/surface_points.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Matrix3Xi;
using Eigen::MatrixXd;
using Eigen::Vector3d;

constexpr double kYoungs = 1e3, kThickness = 0.3;

Matrix3Xd random_points(int n, double size, Random& random) {
  Matrix3Xd x(3, n);
  for (double& c : x.reshaped()) c = size * (random.uniform() - 0.5);
  return x;
}

Matrix3Xd forces(const SelfBarrier& barrier, const Matrix3Xd& x) {
  Matrix3Xd f = Matrix3Xd::Zero(3, x.cols());
  barrier.add_forces(x, f);
  return f;
}

MatrixXd hessian(const SelfBarrier& barrier, const Matrix3Xd& x) {
  SurfaceHessian H;
  barrier.add_hessian(x, H, Curvature::Projected);
  MatrixXd dense = MatrixXd::Zero(x.size(), x.size());
  Matrix3Xd p = Matrix3Xd::Zero(3, x.cols()), y;
  for (int k = 0; k < x.size(); ++k) {
    p(k) = 1;
    y = Matrix3Xd::Zero(3, x.cols());
    H.add_product(p, y);
    dense.col(k) = y.reshaped();
    p(k) = 0;
  }
  return dense;
}

MatrixXd slope_of_forces(const SelfBarrier& barrier, const Matrix3Xd& x) {
  constexpr double kStep = 1e-6;
  MatrixXd dense(x.size(), x.size());
  for (int k = 0; k < x.size(); ++k) {
    Matrix3Xd up = x, down = x;
    up(k) += kStep;
    down(k) -= kStep;
    dense.col(k) = (forces(barrier, down) - forces(barrier, up)).reshaped() / (2 * kStep);
  }
  return dense;
}

struct FoundPair {
  PairNodes node;
  bool is_edges;
  double d;
  int kind;  ///< slides of the nearest points, and 3 more for edges
};

/// All pairs of two triangles 0-1-2 and 3-4-5.
std::vector<FoundPair> pairs_of_triangles(const Matrix3Xd& x) {
  std::vector<FoundPair> found;
  const auto add = [&](const PairNodes& node, bool is_edges) {
    const NearestPoints nearest = nearest_points(node, is_edges, x);
    found.push_back(
        {node, is_edges, between(node, nearest.weight, x).norm(), nearest.n_slides + (is_edges ? 3 : 0)});
  };
  for (int v = 0; v < 3; ++v) {
    add({v, 3, 4, 5}, false);
    add({3 + v, 0, 1, 2}, false);
    for (int w = 0; w < 3; ++w) add({v, (v + 1) % 3, 3 + w, 3 + (w + 1) % 3}, true);
  }
  return found;
}

/// Two triangles that lay far apart at rest.
class TwoTriangles : public testing::Test {
 protected:
  TwoTriangles() {
    F << 0, 3, 1, 4, 2, 5;
    X = random_points(6, 1, random);
    X.rightCols(3).array() += 100;
  }
  Random random{4};
  Matrix3Xi F = Matrix3Xi(3, 2);
  Matrix3Xd X;
};

TEST_F(TwoTriangles, AVertexIsPushedOffAFaceFromItsWholeRangeOn) {
  Matrix3Xd x(3, 6);
  x << -5, 5, 0, 0, 1, 0,  //
      0, 0, 0, 0, 50, 50,  //
      -5, -5, 5, 0, 0, 1;
  for (const double part : {0.1, 0.5, 0.9, 0.99, 1.01}) {
    const SelfBarrier barrier(X, F, kYoungs, kThickness);
    x(1, 3) = part * kThickness;
    EXPECT_EQ(barrier.energy(x) > 0, part < 1) << part;
    EXPECT_EQ(forces(barrier, x)(1, 3) > 0, part < 1) << part;
  }
}

TEST_F(TwoTriangles, ForcesAreMinusTheGradientOfTheEnergyForEveryKindOfNearestPoints) {
  const SelfBarrier barrier(X, F, kYoungs, kThickness);
  constexpr double kStep = 1e-7;
  std::set<int> kinds;
  for (int trial = 0; trial < 60; ++trial) {
    const Matrix3Xd x = random_points(6, 1, random), f = forces(barrier, x);
    double nearest = 1;
    for (const FoundPair& pair : pairs_of_triangles(x)) {
      nearest = std::min(nearest, pair.d);
      if (pair.d < kThickness) kinds.insert(pair.kind);
    }
    if (nearest < 1e-2 || f.isZero(0)) continue;
    for (int k = 0; k < x.size(); ++k) {
      Matrix3Xd up = x, down = x;
      up(k) += kStep;
      down(k) -= kStep;
      EXPECT_NEAR(f(k), -(barrier.energy(up) - barrier.energy(down)) / (2 * kStep), 1e-5 * f.norm());
    }
    Vector3d torque = Vector3d::Zero();
    for (int i = 0; i < 6; ++i) torque += x.col(i).cross(f.col(i));
    EXPECT_LT(f.rowwise().sum().norm(), 1e-12 * f.norm());
    EXPECT_LT(torque.norm(), 1e-12 * f.norm());
  }
  EXPECT_EQ(kinds, (std::set<int>{0, 1, 2, 3, 4, 5}));
}

TEST_F(TwoTriangles, HessianOfAPairIsThePositivePartOfTheSlopeOfForces) {
  const SelfBarrier barrier(X, F, kYoungs, kThickness);
  std::set<int> kinds;
  for (int trial = 0; trial < 3000; ++trial) {
    const Matrix3Xd x = random_points(6, 1.6, random);
    int n_near = 0, kind = 0;
    double d = 0;
    for (const FoundPair& pair : pairs_of_triangles(x))
      if (pair.d < kThickness) {
        ++n_near;
        kind = pair.kind;
        d = pair.d;
      }
    if (n_near != 1 || d < 0.02) continue;
    const Eigen::SelfAdjointEigenSolver<MatrixXd> slope(slope_of_forces(barrier, x));
    const MatrixXd& V = slope.eigenvectors();
    const MatrixXd expected = V * slope.eigenvalues().cwiseMax(0).asDiagonal() * V.transpose();
    EXPECT_LT((hessian(barrier, x) - expected).norm(), 1e-4 * expected.norm()) << kind;
    kinds.insert(kind);
  }
  EXPECT_TRUE(kinds.count(2)) << "a vertex above a triangle";
  EXPECT_TRUE(kinds.count(5)) << "edges that cross";
}

TEST_F(TwoTriangles, NothingPassesThroughWithinTheLargestStepWhichEndsNearATenthOfAGap) {
  const SelfBarrier barrier(X, F, kYoungs, kThickness);
  int n_bounded = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Matrix3Xd x = random_points(6, 1, random), dx = random_points(6, 0.4, random);
    const std::vector<FoundPair> first = pairs_of_triangles(x);
    const double part = barrier.largest_step(x, dx);
    constexpr int kSamples = 400;
    double least = 1;
    for (int k = 1; k <= kSamples; ++k) {
      const std::vector<FoundPair> now = pairs_of_triangles(x + part * k / kSamples * dx);
      for (size_t p = 0; p < now.size(); ++p)
        least = std::min(least, now[p].d / std::min(first[p].d, kThickness));
    }
    EXPECT_GT(least, 0.1 - 1e-9);
    if (part == 1) continue;
    ++n_bounded;
    EXPECT_LT(least, 0.12);
  }
  EXPECT_GT(n_bounded, 20);
}

/// A square sheet of 1 m at a height, its n x n squares cut along either diagonal.
void add_sheet(int n, double height, bool is_turned, Matrix3Xd& X, Matrix3Xi& F) {
  const int first = static_cast<int>(X.cols());
  const Eigen::Index m = F.cols();
  X.conservativeResize(3, first + (n + 1) * (n + 1));
  F.conservativeResize(3, m + 2 * n * n);
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j)
      X.col(first + i * (n + 1) + j) << static_cast<double>(i) / n, static_cast<double>(j) / n, height;
  int f = static_cast<int>(m);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      const int a = first + i * (n + 1) + j, b = a + n + 1;
      if (is_turned) {
        F.col(f++) << a, b, a + 1;
        F.col(f++) << b, b + 1, a + 1;
      } else {
        F.col(f++) << a, b, b + 1;
        F.col(f++) << a, b + 1, a + 1;
      }
    }
}

/// Two sheets that lay far apart at rest, a gap apart and shifted, as the energy per area over kappa b.
double energy_of_layers(int n, double gap, double thickness) {
  Matrix3Xd X(3, 0);
  Matrix3Xi F(3, 0);
  add_sheet(n, 0, false, X, F);
  add_sheet(n, 10, true, X, F);
  const SelfBarrier barrier(X, F, kYoungs, thickness);
  Matrix3Xd x = X;
  x.rightCols(x.cols() / 2).row(2).array() = gap;
  x.rightCols(x.cols() / 2).row(0).array() += 0.37 / n;
  x.rightCols(x.cols() / 2).row(1).array() += 0.21 / n;
  const double e = gap - thickness, b = -e * e * std::log(gap / thickness);
  return barrier.energy(x) / (kYoungs / (50 * thickness) * b);
}

TEST(SelfBarrier, LayersHaveAboutKappaBForEachAreaWhileEdgesAreFourTimesTheRangeOrMore) {
  constexpr double kRange = 0.02, kAbout = 0.25;
  for (const double gap : {0.005, 0.01})
    for (const int n : {3, 6, 12})
      EXPECT_NEAR(energy_of_layers(n, gap, kRange), 1, kAbout) << n << ' ' << gap;
}

TEST(SelfBarrier, ABodyAtRestHasNoEnergyAlsoWhereItIsThinnerThanTheThickness) {
  Matrix3Xd X(3, 0);
  Matrix3Xi F(3, 0);
  add_sheet(6, 0, false, X, F);
  add_sheet(6, 0.01, false, X, F);
  SelfBarrier barrier(X, F, kYoungs, 0.05);
  EXPECT_EQ(barrier.energy(X), 0);
  Matrix3Xd x = X;
  x.rightCols(x.cols() / 2).row(2).array() = 0.004;
  EXPECT_GT(barrier.energy(x), 0) << "and yet nothing passes through";
  x.rightCols(x.cols() / 2).row(2).array() = -0.01;
  EXPECT_LT(barrier.largest_step(X, x - X), 0.5);
  EXPECT_TRUE(barrier.passes_through(X, x));
  Matrix3Xd y = x;
  EXPECT_TRUE(barrier.keep_out(X, y));
  EXPECT_FALSE(barrier.passes_through(X, y));
}

// The tip of one triangle above the middle of another is the one pair in touch, so that Coulomb's law is exact.
TEST(SelfBarrier, FrictionHoldsBackATipByItsCoefficientTimesTheForceThatPressesItOnceItSlips) {
  constexpr double kFriction = 0.3, kGap = 0.01, kRange = 0.02, kTime = 0.1;
  Matrix3Xi F(3, 2);
  F << 0, 3, 1, 4, 2, 5;
  Matrix3Xd x(3, 6), X;
  x << -1, 1, 0, 0, 0.3, -0.3, -1, -1, 1, 0, 0, 0, 0, 0, 0, kGap, 1, 1;
  X = x;
  X.rightCols(3).row(2).array() += 10;
  SelfBarrier rough(X, F, kYoungs, kRange, kFriction);
  const SelfBarrier smooth(X, F, kYoungs, kRange);
  rough.begin_step(0, kTime, x);
  const double pressed = forces(smooth, x)(2, 3), slip = 0.1 * kRange * kTime;
  ASSERT_GT(pressed, 0);
  const auto slid = [&](double by) {
    Matrix3Xd y = x;
    y.rightCols(3).row(1).array() += by;
    return y;
  };
  const auto friction_at = [&](double by) -> Matrix3Xd {
    return forces(rough, slid(by)) - forces(smooth, slid(by));
  };
  for (const double by : {1.5 * slip, 10 * slip}) {
    const Matrix3Xd friction = friction_at(by);
    EXPECT_NEAR(friction(1, 3), -kFriction * pressed, 1e-9 * pressed);
    EXPECT_LT((friction.col(3) + friction.leftCols(3).rowwise().sum()).norm(), 1e-12 * pressed) << "momentum";
  }
  const double q = 0.4;  // of the slip: 2 q - q^2 of the limit [Li et al. 2020]
  EXPECT_NEAR(friction_at(q * slip)(1, 3), -kFriction * pressed * (2 - q) * q, 1e-9 * pressed);
}

TEST(FlatTriangles, OfQuadraticFacesAreFourInEachAndTurnedAlike) {
  Eigen::MatrixXi face(6, 1);
  face << 0, 1, 2, 3, 4, 5;
  Matrix3Xd X(3, 6);
  X << 0, 2, 0, 1, 1, 0, 0, 0, 2, 0, 1, 1, 0, 0, 0, 0, 0, 0;
  const Matrix3Xd areas = area_vectors(X, flat_triangles(face));
  ASSERT_EQ(areas.cols(), 4);
  for (const auto& a : areas.colwise()) EXPECT_LT((a - Vector3d(0, 0, 0.5)).norm(), 1e-14);
}

}  // namespace
}  // namespace testbed::meshing
