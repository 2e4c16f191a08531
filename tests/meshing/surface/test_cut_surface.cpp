#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

#include "meshing/surface/cut_surface.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/surfaces.h"

using namespace testbed::meshing;

namespace {

constexpr double kRounding = 1e-12;

/// A box of two triangles a side.
SurfaceMesh box(const Eigen::Vector3d& size) {
  return make_shape("bar", 8, size);
}

Eigen::Vector3d edge_lengths(const SurfaceMesh& surface, Eigen::Index f) {
  Eigen::Vector3d lengths;
  for (int c = 0; c < 3; ++c)
    lengths[c] = (surface.X.col(surface.F(c, f)) - surface.X.col(surface.F((c + 1) % 3, f))).norm();
  return lengths;
}

double least_angle(const SurfaceMesh& surface) {
  double least = M_PI;
  for (Eigen::Index f = 0; f < surface.F.cols(); ++f) {
    const Eigen::Vector3d l = edge_lengths(surface, f);
    for (int c = 0; c < 3; ++c) {
      const double a = l[c], b = l[(c + 1) % 3], opposite = l[(c + 2) % 3];
      least = std::min(least, std::acos((a * a + b * b - opposite * opposite) / (2 * a * b)));
    }
  }
  return least;
}

/// A plate with a vertex near the middle of a face's diagonal, and the flat triangle that they make.
struct Capped {
  SurfaceMesh plate = box({1, 1, 0.3});
  int cap, beyond;  ///< triangles: the flat one, and that on the diagonal's other side

  /// @param off  the vertex from the diagonal, in the face and out of it (m)
  explicit Capped(const Eigen::Vector2d& off) {
    int f = 0, c = 0;
    const auto length = [&] { return edge_lengths(plate, f)[c]; };
    while (length() < 1.4) c == 2 ? (c = 0, ++f) : ++c;
    const Eigen::Vector3i t = plate.F.col(f);
    const int a = t[c], b = t[(c + 1) % 3], apex = t[(c + 2) % 3], p = 8;
    const auto has = [&](int g, int v) { return (plate.F.col(g).array() == v).any(); };
    beyond = 0;
    while (beyond == f || !has(beyond, a) || !has(beyond, b)) ++beyond;
    cap = static_cast<int>(plate.F.cols()) + 1;
    const Eigen::Vector3d middle = (plate.X.col(a) + plate.X.col(b)) / 2,
                          normal = area_vectors(plate.X, plate.F).col(f).normalized();
    plate.X.conservativeResize(Eigen::NoChange, p + 1);
    plate.X.col(p) = middle + off[0] * (plate.X.col(apex) - middle).normalized() + off[1] * normal;
    plate.F.conservativeResize(Eigen::NoChange, cap + 1);
    plate.F.col(f) << b, apex, p;
    plate.F.col(cap - 1) << apex, a, p;
    plate.F.col(cap) << a, b, p;
  }
};

class Cut : public testing::TestWithParam<const char*> {
 protected:
  const SurfaceMesh before =
      GetParam() == std::string("needles") ? box({10, 1, 0.2}) : make_shape("torus", 300, {1, 0.3, 0});
  const double wanted = GetParam() == std::string("needles") ? 0.3 : 0.1;
  const SurfaceMesh after = cut_surface(before, Eigen::VectorXd::Constant(before.F.cols(), wanted), 100000);
};
INSTANTIATE_TEST_SUITE_P(Surface, Cut, testing::Values("needles", "torus"),
                         [](const auto& info) { return std::string(info.param); });

}  // namespace

TEST_P(Cut, LeavesThePolyhedronItsFirstVerticesAndNoEdgeThatIsTooLong) {
  EXPECT_NO_THROW(check_closed(after, GetParam()));
  ASSERT_GT(after.F.cols(), 2 * before.F.cols());
  EXPECT_EQ(after.X.leftCols(before.X.cols()), before.X);
  EXPECT_EQ(after.cuts.F, before.F);
  EXPECT_NEAR(volume(after.X, after.F), volume(before.X, before.F), kRounding);
  for (Eigen::Index f = 0; f < after.F.cols(); ++f) EXPECT_LE(edge_lengths(after, f).maxCoeff(), wanted);
  EXPECT_GT(edge_lengths(after, 0).maxCoeff(), wanted / 2) << "no more cuts than needed";
}

TEST_P(Cut, NamesTheTriangleThatEachIsAPartOf) {
  Eigen::VectorXd area = Eigen::VectorXd::Zero(before.F.cols());
  const Eigen::Matrix3Xd vectors = area_vectors(after.X, after.F), whole = area_vectors(before.X, before.F);
  for (Eigen::Index f = 0; f < after.F.cols(); ++f) {
    const int parent = after.cuts.parent[f];
    area[parent] += vectors.col(f).norm();
    EXPECT_LT(vectors.col(f).cross(whole.col(parent)).norm(), kRounding);
  }
  EXPECT_LT((area - whole.colwise().norm().transpose()).cwiseAbs().maxCoeff(), kRounding);
}

TEST_P(Cut, NamesTheVerticesThatEachLiesBetween) {
  std::set<std::set<int>> edges, triangles;
  for (const auto& f : before.F.colwise()) {
    triangles.insert({f[0], f[1], f[2]});
    for (int c = 0; c < 3; ++c) edges.insert({f[c], f[(c + 1) % 3]});
  }
  int n_on_edges = 0;
  for (int v = 0; v < after.X.cols(); ++v) {
    const Eigen::Vector3i between = after.cuts.between.col(v);
    const std::set<int> corners(between.begin(), between.end());
    Eigen::Matrix<double, 4, Eigen::Dynamic> sum(4, corners.size());  // with weights of sum 1
    Eigen::Index k = 0;
    for (const int corner : corners) sum.col(k++) << before.X.col(corner), 1;
    const Eigen::Vector4d x(after.X(0, v), after.X(1, v), after.X(2, v), 1);
    const Eigen::VectorXd weights = sum.colPivHouseholderQr().solve(x);
    EXPECT_LT((sum * weights - x).norm(), kRounding);
    EXPECT_GT(weights.minCoeff(), kRounding) << "between all of them, or named too many";
    if (v < before.X.cols())
      EXPECT_EQ(corners, std::set<int>{v});
    else
      EXPECT_TRUE(edges.count(corners) + triangles.count(corners)) << v;
    n_on_edges += corners.size() == 2;
  }
  EXPECT_GT(n_on_edges, 0);
}

TEST_P(Cut, LeavesNoAngleBelowHalfOfTheLeastBefore) {
  EXPECT_GE(least_angle(after), least_angle(before) / 2 - kRounding);
}

TEST_P(Cut, ASecondTimeIsAsIfItHadBeenCutSoAtOnce) {
  const SurfaceMesh again = cut_surface(after, Eigen::VectorXd::Constant(after.F.cols(), wanted / 2), 100000);
  const SurfaceMesh at_once =
      cut_surface(before, Eigen::VectorXd::Constant(before.F.cols(), wanted / 2), 100000);
  EXPECT_EQ(again.X.leftCols(after.X.cols()), after.X);
  EXPECT_EQ(again.cuts.F, before.F);
  ASSERT_EQ(again.X.cols(), at_once.X.cols());
  const auto places = [](const SurfaceMesh& surface) {
    std::set<std::vector<double>> result;  // of vertices, and the corners that they lie between
    for (Eigen::Index v = 0; v < surface.X.cols(); ++v) {
      const Eigen::Vector3d x = surface.X.col(v);
      Eigen::Vector3i between = surface.cuts.between.col(v);
      std::sort(between.begin(), between.end());
      if (between[1] == between[2]) between[1] = between[0];  // on an edge
      result.insert({x[0], x[1], x[2], 1. * between[0], 1. * between[1], 1. * between[2]});
    }
    return result;
  };
  EXPECT_EQ(places(again), places(at_once));
}

TEST(CutSurface, CutsNeighboursOfSmallTrianglesAtTheirLongestEdges) {
  const SurfaceMesh plate = box({10, 1, 0.2});
  Eigen::VectorXd wanted = Eigen::VectorXd::Constant(plate.F.cols(), 100);
  wanted[0] = 0.1;
  const SurfaceMesh cut = cut_surface(plate, wanted, 100000);
  EXPECT_GT(cut.F.cols(), 100);
  EXPECT_GE(least_angle(cut), least_angle(plate) / 2 - kRounding);
}

TEST(CutSurface, SpendsAFewVerticesWhereEdgesAreMostTooLong) {
  const SurfaceMesh bar = box({10, 1, 1});
  Eigen::VectorXd wanted = Eigen::VectorXd::Constant(bar.F.cols(), 1);
  EXPECT_EQ(cut_surface(bar, wanted, 8).X.cols(), 8);
  const SurfaceMesh cut = cut_surface(bar, wanted, 20);
  EXPECT_GE(cut.X.cols(), 20);
  EXPECT_LE(cut.X.cols(), 24) << "the last cut may need others";
  double longest = 0;
  for (Eigen::Index f = 0; f < cut.F.cols(); ++f)
    longest = std::max(longest, edge_lengths(cut, f).maxCoeff());
  EXPECT_LT(longest, 5.2) << "all long edges were cut before any part of them";
}

TEST(EdgesAcross, AreThoseThatFitThroughAPlateAndIntoABall) {
  const SurfaceMesh plate = box({10, 10, 0.3});
  const Eigen::Matrix3Xd areas = area_vectors(plate.X, plate.F);
  const Eigen::VectorXd longest = edges_across(plate, 3);
  const double edge = std::sqrt(200.), tolerance = std::pow(2., -8);
  for (Eigen::Index f = 0; f < longest.size(); ++f)
    if (std::abs(areas(2, f)) > 1) {
      EXPECT_NEAR(longest[f], 0.1, tolerance * edge);
    }
  const SurfaceMesh ball = make_shape("ball", 42, {1, 1, 1});
  const double of_volume = std::cbrt(volume(ball.X, ball.F)) * 1.3 / 6;
  EXPECT_NEAR(edges_across(ball, 2).minCoeff(), of_volume, kRounding);
  EXPECT_NEAR(edges_across(ball, 2).maxCoeff(), of_volume, kRounding);
  EXPECT_NEAR(edges_across(ball, 20).maxCoeff(), 0.05, 0.01) << "1 m across";
}

TEST(CutAcross, ChangesNothingThatIsThickEnoughAndIsBoundedInThinSheets) {
  const SurfaceMesh ball = make_shape("ball", 642, {1, 1, 1}), sheet = box({4, 4, 0.3});
  EXPECT_EQ(cut_across(ball, 1).surface.cuts.F.size(), 0);
  EXPECT_EQ(cut_across(sheet, 0).surface.F, sheet.F);
  const CutSurface cut = cut_across(sheet, 1);
  EXPECT_FALSE(cut.is_bounded);
  const Eigen::Matrix3Xd vectors = area_vectors(cut.surface.X, cut.surface.F);
  for (Eigen::Index f = 0; f < cut.surface.F.cols(); ++f)
    if (std::abs(vectors(2, f)) > kRounding) {
      EXPECT_LE(edge_lengths(cut.surface, f).maxCoeff(), 0.3);
    }
  const CutSurface bounded = cut_across(sheet, 10);
  EXPECT_TRUE(bounded.is_bounded);
  EXPECT_GE(bounded.surface.X.cols(), 5000);
  EXPECT_LE(bounded.surface.X.cols(), 5010);
}

TEST(CutAcross, GivesFlatCapsToTheTrianglesBesideThem) {
  const Capped capped({1e-9, 0});
  const SurfaceMesh& plate = capped.plate;
  ASSERT_NO_THROW(check_closed(plate, "plate"));
  ASSERT_LT(least_angle(plate), 1e-8);
  const SurfaceMesh flipped = cut_across(plate, 1e-3, 1e9).surface;
  EXPECT_EQ(flipped.X, plate.X);
  ASSERT_EQ(flipped.F.cols(), plate.F.cols());
  EXPECT_NO_THROW(check_closed(flipped, "flipped"));
  EXPECT_NEAR(volume(flipped.X, flipped.F), volume(plate.X, plate.F), kRounding);
  EXPECT_GT(least_angle(flipped), 0.1);
  double area = 0;
  for (Eigen::Index f = 0; f < flipped.F.cols(); ++f) {
    EXPECT_NE(flipped.cuts.parent[f], capped.cap);
    if (flipped.cuts.parent[f] == capped.beyond) area += area_vectors(flipped.X, flipped.F).col(f).norm();
  }
  EXPECT_NEAR(area, 0.5, 1e-8);
  const SurfaceMesh cut = cut_across(plate, 2).surface;
  EXPECT_GT(cut.X.cols(), 50);
  EXPECT_NO_THROW(check_closed(cut, "cut"));
  EXPECT_GT(least_angle(cut), 0.1);
}

TEST(CutAcross, LeavesFlatCapsThatStandOutOfThePlaneAndNeedlesOfAShortEdge) {
  const Capped ridge({1e-4, 1e-5});
  EXPECT_EQ(cut_across(ridge.plate, 1e-3, 1e9).surface.F, ridge.plate.F);
  const SurfaceMesh blade = box({1, 0.5, 5e-5});
  EXPECT_EQ(cut_across(blade, 1e-3, 1e9).surface.F, blade.F);
}

TEST(CutAcross, LeavesNoNeedleInAPlane) {
  const SurfaceMesh plate = fanned_plate(41), cut = cut_across(plate, 1).surface;
  ASSERT_NO_THROW(check_closed(plate, "plate"));
  EXPECT_NO_THROW(check_closed(cut, "cut"));
  EXPECT_EQ(cut.X.leftCols(plate.X.cols()), plate.X);
  EXPECT_EQ(cut.cuts.F, plate.F);
  EXPECT_NEAR(volume(cut.X, cut.F), volume(plate.X, plate.F), kRounding);
  EXPECT_LT(least_angle(plate), 0.05);
  EXPECT_GT(least_angle(cut), 0.19) << "of the sides, whose edges are 0.05 and 0.2 m long";
  const Eigen::VectorXd longest = edges_across(plate, 1);
  EXPECT_LE(longest_edges(cut).maxCoeff(), longest.maxCoeff());
  EXPECT_LT(cut.X.cols(), cut_surface(plate, longest, 100000).X.cols() / 2);
  // No vertex lies within the circle about the corners of a triangle of the same plane.
  for (const auto& t : cut.F.colwise()) {
    const Eigen::Vector3d a = cut.X.col(t[0]), p = cut.X.col(t[1]) - a, q = cut.X.col(t[2]) - a,
                          n = p.cross(q);
    const Eigen::Vector3d to_centre =
        (p.squaredNorm() * q.cross(n) + q.squaredNorm() * n.cross(p)) / (2 * n.squaredNorm());
    for (const auto& x : cut.X.colwise())
      if (std::abs(n.dot(x - a)) < kRounding) {
        EXPECT_GT((x - a - to_centre).norm(), 0.99 * to_centre.norm());
      }
  }
}

namespace {

class Parts : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Surface, Parts, testing::Range(0, 12));

}  // namespace

TEST_P(Parts, HoldTheSameOfACutSurface) {
  const SurfaceMesh plate = fanned_plate(11);
  const Eigen::Index n = plate.X.cols();
  std::srand(GetParam());
  // Some vertices drawn at random, few or nearly all, and those of a half space.
  std::vector<std::vector<bool>> parts(2, std::vector<bool>(n));
  for (Eigen::Index v = 0; v < n; ++v) {
    parts[0][v] = std::rand() % 12 >= GetParam();
    parts[1][v] = plate.X(0, v) < 0.19 * GetParam();
  }
  const SurfaceMesh once = cut_across(plate, 1, 1, parts).surface;
  ASSERT_GT(once.X.cols(), 2 * n);
  for (const SurfaceMesh& cut : {once, cut_surface(once, longest_edges(once) / 2, 100000)}) {
    const auto has = [&](const std::vector<bool>& part, const Eigen::Vector3i& of) {
      return std::all_of(of.begin(), of.end(), [&](int v) { return part[v]; });
    };
    for (const std::vector<bool>& part : parts) {
      // By brute force: what lies in a triangle, on an edge or at a vertex that the part has.
      const auto is_held = [&](const Eigen::Vector3d& x) {
        for (const auto& t : plate.F.colwise()) {
          std::vector<int> of;
          for (const int v : t)
            if (part[v]) of.push_back(v);
          if (!of.empty() && lies_among(x, plate.X(Eigen::all, of))) return true;
        }
        return false;
      };
      const auto is_loaded = [&](const Eigen::Vector3d& x) {
        for (const auto& t : plate.F.colwise())
          if (has(part, t) && lies_among(x, plate.X(Eigen::all, t))) return true;
        return false;
      };
      for (Eigen::Index v = 0; v < cut.X.cols(); ++v)
        EXPECT_EQ(has(part, cut.cuts.between.col(v)), is_held(cut.X.col(v))) << cut.X.col(v).transpose();
      for (Eigen::Index f = 0; f < cut.F.cols(); ++f)
        EXPECT_EQ(has(part, plate.F.col(cut.cuts.parent[f])),
                  is_loaded(cut.X(Eigen::all, cut.F.col(f)).rowwise().mean()));
    }
  }
}
