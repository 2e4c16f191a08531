#include <gtest/gtest.h>
#include <omp.h>

#include <cmath>
#include <map>
#include <set>

#include "massspring/calibrations/calibrate.h"
#include "massspring/statics/quasi_static.h"
#include "massspring/time/integrators.h"
#include "meshing/algebra/single_precision.h"
#include "meshing/algebra/subdomains.h"
#include "meshing/network/network.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "tests/massspring/small_network.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

/// What work returns on n threads.
template <class Work>
auto on_threads(int n_threads, const Work& work) {
  omp_set_num_threads(n_threads);
  auto result = work();
  omp_set_num_threads(1);
  return result;
}

class Subdomains : public testing::Test {
 protected:
  static MassSpringModel make() {
    const SurfaceMesh surface = make_shape("ball", 2562);
    return calibrate(link_pcp(surface, sample_interior(surface, {}), {}), Material{},
                     find_calibration("affine"));
  }
  const MassSpringModel model = make();
  const Springs& springs = *model.springs;
  const State state = initial_state(model);
  const Matrix3Xd x = model.network.X + random_points(static_cast<int>(model.mass.size()), 0.01, 1);
};

TEST_F(Subdomains, HoldEverySpringOnceAndOfOneSizeShareNoNode) {
  ASSERT_GE(model.mass.size(), kLeastSubdivided);
  ASSERT_EQ(springs.first.size(), 2 * kSubdomains + 1);
  EXPECT_EQ(springs.first.front(), 0);
  EXPECT_EQ(springs.first.back(), springs.E.cols());
  for (int first = 0, size = 8; size > 0; first += size, size /= 2) {
    std::set<int> taken;
    for (int subdomain = first; subdomain < first + size; ++subdomain) {
      std::set<int> own;
      for (int k : {subdomain, kSubdomains + subdomain})
        for (int s = springs.first[k]; s < springs.first[k + 1]; ++s)
          own.insert({springs.E(0, s), springs.E(1, s)});
      for (int node : own)
        EXPECT_TRUE(taken.insert(node).second) << "node " << node << ", subdomain " << subdomain;
    }
  }
  int n_in_leaves = 0;
  for (int k : {0, kSubdomains}) n_in_leaves += springs.first[k + 8] - springs.first[k];
  EXPECT_GT(n_in_leaves, 0.7 * static_cast<double>(springs.E.cols()));
}

TEST(AlongBody, NeighboursFollowEachOther) {
  constexpr int n = 8;  // points in a row of a cube, whose halves, quarters and eighths are whole pieces
  Matrix3Xd points(3, n * n * n);
  for (int i = 0; i < points.cols(); ++i)
    points.col(i) = Eigen::Vector3i(i % n, i / n % n, i / (n * n)).cast<double>();
  std::vector<int> order = along_body(points);
  for (int size = n * n * n; size >= 8; size /= 8) {
    const int side = static_cast<int>(std::lround(std::cbrt(size)));
    for (int begin = 0; begin < points.cols(); begin += size) {
      const Matrix3Xd piece =
          points(Eigen::all, std::vector<int>(order.begin() + begin, order.begin() + begin + size));
      EXPECT_EQ((piece.rowwise().maxCoeff() - piece.rowwise().minCoeff()).maxCoeff(), side - 1);
    }
  }
  std::sort(order.begin(), order.end());
  for (int i = 0; i < points.cols(); ++i) EXPECT_EQ(order[i], i) << "each once";
}

// Points crowd about a corner, so that their lowest bits count, too.
TEST(AlongBody, FollowsTheBitsOfTheCoordinatesInTurn) {
  constexpr int n = 2000, kBits = 21;
  Matrix3Xd points = random_points(n, 1, 1).cwiseAbs();
  for (int i = 0; i < n; ++i) points.col(i) *= std::exp2(-(i % kBits));
  points.col(0).setZero();
  const Eigen::Vector3d low = points.rowwise().minCoeff();
  const double cells = ((1 << kBits) - 1) / (points.colwise() - low).maxCoeff();
  long before = 0;
  for (const int i : along_body(points)) {
    const Eigen::Vector3d place = (points.col(i) - low) * cells;
    long code = 0;
    for (int bit = kBits - 1; bit >= 0; --bit)
      for (int k = 2; k >= 0; --k) code = 2 * code + (static_cast<long>(place[k]) >> bit & 1);
    EXPECT_LE(before, code);
    before = code;
  }
}

TEST(Leaves, OfABarAreSlicesAcrossIt) {
  constexpr int n = 80;
  const Matrix3Xd X = Eigen::Vector3d(1, 16, 1).asDiagonal() * random_points(n, 1, 1);
  const std::vector<int> leaf = leaves_of(X);
  for (int i = 0; i < n; ++i) {
    const auto n_before = (X.row(1).array() < X(1, i)).count();
    EXPECT_EQ(leaf[i], n_before / (n / 8)) << i;
  }
}

void expect_surface_first(const MassSpringModel& model) {
  const Eigen::Matrix2Xi E = edges_of(model.network.F);
  std::set<std::pair<int, int>> edges;
  for (const auto& e : E.colwise()) edges.insert(std::minmax(e(0), e(1)));
  const Eigen::Matrix2Xi& springs = model.springs->E;
  for (Eigen::Index s = 0; s < springs.cols(); ++s)
    EXPECT_EQ(edges.count(std::minmax(springs(0, s), springs(1, s))) == 1,
              s < static_cast<Eigen::Index>(edges.size()));
}

TEST_F(Subdomains, PutTheEdgesOfTheSurfaceFirst) {
  expect_surface_first(model);
}

/// Of cubes of side 0.5 m.
SpringNetwork box_network() {
  const TetMesh mesh = box_tets(3, 3, 3, 0.5);
  SpringNetwork network;
  network.X = mesh.X;
  network.F = mesh.F;
  network.T = mesh.T;
  network.n_surface = static_cast<int>(mesh.X.cols());
  return network;
}

TEST(Springs, OfTetrahedraHaveTheEdgesOfTheSurfaceFirst) {
  expect_surface_first(calibrate(box_network(), Material{}, find_calibration("van_gelder")));
}

// (A_1 + A_2)/|e|^2 is 1 for the sides of halves of squares, and 1/2 for the diagonals of squares.
TEST(Springs, AreStiffenedByASkinAlongTheEdgesOfTheSurface) {
  const SpringNetwork network = box_network();
  MassSpringModel model = calibrate(network, Material{}, find_calibration("van_gelder"));
  const Springs before = *model.springs;
  Skin skin;
  skin.stiffness = 10;
  add_skin(skin, model);
  ASSERT_EQ(model.springs->E, before.E);
  std::set<std::pair<int, int>> edges;
  for (const auto& t : network.F.colwise())
    for (int k = 0; k < 3; ++k) edges.insert(std::minmax(t(k), t((k + 1) % 3)));
  int n_sides = 0, n_diagonals = 0;
  for (Eigen::Index s = 0; s < before.E.cols(); ++s) {
    const int a = before.E(0, s), b = before.E(1, s);
    const bool is_edge = edges.count(std::minmax(a, b)) == 1,
               is_side = (network.X.col(a) - network.X.col(b)).norm() < 0.6;
    n_sides += is_edge && is_side;
    n_diagonals += is_edge && !is_side;
    const double added = is_edge ? skin.stiffness * (is_side ? 1 : 0.5) : 0;
    EXPECT_NEAR(model.springs->stiffness(s), before.stiffness(s) + added, 1e-12 * before.stiffness(s));
  }
  EXPECT_EQ(n_sides, 6 * 3 * 3 * 2);
  EXPECT_EQ(n_diagonals, 6 * 3 * 3);
}

// As those of `moment`, which are in another order and need not have every edge of the surface.
TEST(Springs, AreStiffenedByASkinWhicheverThereAre) {
  const SpringNetwork network = box_network();
  MassSpringModel model = calibrate(network, Material{}, find_calibration("van_gelder"));
  Skin skin;
  skin.stiffness = 10;
  MassSpringModel expected = model;
  add_skin(skin, expected);
  const auto stiffness_of = [](const Springs& springs) {
    std::map<std::pair<int, int>, double> stiffness;
    for (Eigen::Index s = 0; s < springs.E.cols(); ++s)
      stiffness[std::minmax(springs.E(0, s), springs.E(1, s))] += springs.stiffness(s);
    return stiffness;
  };
  auto lacking = stiffness_of(*expected.springs);
  const int a = model.springs->E(0, 0), b = model.springs->E(1, 0);  // along the surface
  lacking[std::minmax(a, b)] -= model.springs->stiffness(0);
  const Eigen::Index n = model.springs->E.cols() - 1;
  model.springs->E = model.springs->E.rightCols(n).rowwise().reverse().eval();
  model.springs->stiffness = model.springs->stiffness.tail(n).reverse().eval();
  model.springs->first.clear();
  add_skin(skin, model);
  const auto found = stiffness_of(*model.springs);
  ASSERT_EQ(found.size(), lacking.size());
  for (const auto& [edge, k] : lacking) EXPECT_NEAR(found.at(edge), k, 1e-12 * k);
}

TEST_F(Subdomains, SumsHaveTheSameBitsOnAnyNumberOfThreads) {
  const SpringBlocks B = hessian(springs, state.rest_length, x);
  const auto sums = [&] {
    Matrix3Xd f = Matrix3Xd::Ones(3, x.cols()), y = f;
    add_forces(springs, state.rest_length, x, f);
    add_product(springs, B, x, y);
    return std::pair(f, y);
  };
  const auto one = on_threads(1, sums);
  Springs undivided = springs;
  undivided.first.clear();
  Matrix3Xd f = Matrix3Xd::Ones(3, x.cols());
  add_forces(undivided, state.rest_length, x, f);
  EXPECT_LT((one.first - f).norm(), 1e-13 * f.norm());
  for (int n_threads : {2, 3, 8}) {
    const auto many = on_threads(n_threads, sums);
    EXPECT_EQ(one.first, many.first) << n_threads;
    EXPECT_EQ(one.second, many.second) << n_threads;
  }
}

TEST_F(Subdomains, ExplicitStepsOnAFloorHaveTheSameBitsOnOneThreadAndTwo) {
  Forces forces;
  forces.load = Eigen::Vector3d(0, -9.81, 0) * model.mass.transpose();
  forces.mass_damping = 1;
  add_volume_penalty(1e4, model, forces);
  Obstacle floor;
  floor.shape = HalfSpace{{0, x.row(1).minCoeff(), 0}, {0, 1, 0}};
  Contacts contacts;
  contacts.bodies.emplace_back(floor);
  const auto end = [&] {
    State moved = state;
    moved.x = x;
    TimeStepper stepper(model, forces, "symplectic_euler", 1, {}, contacts);
    for (int n = 0; n < 20; ++n) EXPECT_EQ(stepper.step(moved, 1e-4).status, Status::Ok);
    return moved;
  };
  const State one = on_threads(1, end), two = on_threads(2, end);
  EXPECT_GT((one.x - x).norm(), 1e-3 * x.norm());
  EXPECT_EQ(one.x, two.x);
  EXPECT_EQ(one.v, two.v);
}

class CoupledSubdomains : public testing::TestWithParam<const char*> {
 protected:
  static MassSpringModel make() {
    constexpr int n = 17;
    const TetMesh mesh = box_tets(n, n, n, 1. / n, 0.2);
    return calibrate({mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface}, Material{},
                     find_calibration(GetParam()));
  }
  const MassSpringModel model = make();
  const TetSprings& springs = *model.tet_springs;
  const int n = static_cast<int>(model.mass.size());
  const Matrix3Xd x = model.network.X + random_points(n, 0.01, 1);
  Forces forces = no_forces(model);

  void SetUp() override {
    ASSERT_GE(n, kLeastSubdivided);
    forces.load = Eigen::Vector3d(0, -9.81, 0) * model.mass.transpose();
    for (int i = 0; i < n; ++i)
      if (model.network.X(1, i) < 0.01)
        forces.constraints.push_back({i, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  }
};

TEST_P(CoupledSubdomains, OfOneSizeShareNoNodeAndHoldEveryPatchOnce) {
  ASSERT_EQ(springs.subdomain_first.size() % kSubdomains, 1);
  EXPECT_EQ(springs.subdomain_first.front(), 0);
  EXPECT_EQ(springs.subdomain_first.back(), springs.n_patches());
  int n_in_leaves = 0;
  for (int first = 0, size = 8; size > 0; first += size, size /= 2) {
    std::vector<int> owner(n, -1);
    for (int subdomain = first; subdomain < first + size; ++subdomain)
      for (std::size_t k = subdomain; k + 1 < springs.subdomain_first.size(); k += kSubdomains)
        for (int p = springs.subdomain_first[k]; p < springs.subdomain_first[k + 1]; ++p) {
          n_in_leaves += size == 8;
          for (int e = springs.first[p]; e < springs.first[p + 1]; ++e) {
            int& other = owner[springs.node[e]];
            EXPECT_TRUE(other == -1 || other == subdomain)
                << "patch " << p << ", subdomains " << other << ", " << subdomain;
            other = subdomain;
          }
        }
  }
  EXPECT_GT(n_in_leaves, 0.5 * springs.n_patches());
}

TEST_P(CoupledSubdomains, SumsHaveTheSameBitsOnAnyNumberOfThreads) {
  struct Sums {
    double energy;
    Matrix3Xd f, linear_f, Kq;
    std::vector<Eigen::Matrix3d> K;
    PaddedField single, of_patches;
    double p_Kp;
  };
  // Over twelve decades: not every order adds single-precision numbers exactly.
  const Matrix3Xd q = x * Eigen::pow(10, Eigen::ArrayXd::LinSpaced(n, -6, 6)).matrix().asDiagonal();
  const auto sums_of = [&](const TetSprings& patches) {
    Sums sums;
    sums.energy = energy(patches, x);
    sums.f = Matrix3Xd::Ones(3, n);
    add_forces(patches, x, sums.f);
    sums.linear_f = Matrix3Xd::Ones(3, n);
    add_linear_forces(patches, x, sums.linear_f);
    BlockMatrix K = stiffness_pattern(model);
    add_hessian(patches, x, K);
    mirror(K);
    multiply(K, q, sums.Kq);
    PaddedField p;
    pad(q, 1, p);
    sums.single = p;
    sums.p_Kp = add_product(K, single_precision(K), p, sums.single);
    sums.K = K.block;
    sums.of_patches = p;
    add_product(patches, single_precision(patches), p, sums.of_patches);
    return sums;
  };
  const Sums one = on_threads(1, [&] { return sums_of(springs); });
  for (int n_threads : {2, 3, 8}) {
    const Sums many = on_threads(n_threads, [&] { return sums_of(springs); });
    EXPECT_EQ(one.energy, many.energy) << n_threads;
    EXPECT_EQ(one.f, many.f) << n_threads;
    EXPECT_EQ(one.K, many.K) << n_threads;
    EXPECT_EQ(one.Kq, many.Kq) << n_threads;
    EXPECT_EQ(one.single, many.single) << n_threads;
    EXPECT_EQ(one.p_Kp, many.p_Kp) << n_threads;
    EXPECT_EQ(one.linear_f, many.linear_f) << n_threads;
    EXPECT_EQ(one.of_patches, many.of_patches) << n_threads;
  }
  TetSprings undivided = springs;
  undivided.subdomain_first.clear();
  const Sums other = sums_of(undivided);
  EXPECT_NEAR(one.energy, other.energy, 1e-12 * std::abs(other.energy));
  EXPECT_LT((one.f - other.f).norm(), 1e-12 * other.f.norm());
  EXPECT_LT((one.Kq - other.Kq).norm(), 1e-12 * other.Kq.norm());
  EXPECT_LT((one.single.topLeftCorner(3, n).cast<double>() - q - one.Kq).norm(), 1e-5 * one.Kq.norm());
  EXPECT_NEAR(one.p_Kp, q.cwiseProduct(q + one.Kq).sum(), 1e-5 * std::abs(one.p_Kp));
}

TEST_P(CoupledSubdomains, ImplicitStepsHaveTheSameBitsOnOneThreadAndTwo) {
  const auto end = [&] {
    State state = initial_state(model);
    state.x = x;
    TimeStepper stepper(model, forces, "implicit_euler", 1);
    EXPECT_EQ(stepper.step(state, 1e-3).status, Status::Ok);
    return state;
  };
  const State one = on_threads(1, end), two = on_threads(2, end);
  EXPECT_GT((one.x - x).norm(), 1e-4 * x.norm());
  EXPECT_EQ(one.x, two.x);
  EXPECT_EQ(one.v, two.v);
}

class Equilibria : public CoupledSubdomains {};

TEST_P(Equilibria, HaveTheSameBitsOnOneThreadAndTwo) {
  const auto end = [&] {
    State state = initial_state(model);
    EXPECT_EQ(QuasiStaticSolver(model, forces).solve(1, state).status, Status::Ok);
    return state.x;
  };
  const Matrix3Xd one = on_threads(1, end), two = on_threads(2, end);
  EXPECT_GT((one - model.network.X).norm(), 0);
  EXPECT_EQ(one, two);
}

INSTANTIATE_TEST_SUITE_P(, CoupledSubdomains, testing::Values("edge_coupled", "node_averaged"));
INSTANTIATE_TEST_SUITE_P(, Equilibria, testing::Values("edge_coupled"));

}  // namespace
}  // namespace testbed::massspring
