#include <gtest/gtest.h>
#include <omp.h>

#include <set>

#include "massspring/calibrate.h"
#include "massspring/integrators.h"
#include "massspring/parts.h"
#include "meshing/network.h"
#include "meshing/shapes.h"
#include "meshing/surface.h"
#include "tests/massspring/box_tets.h"
#include "tests/massspring/small_network.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

class Parts : public testing::Test {
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

TEST_F(Parts, HoldEverySpringOnceAndOfOneSizeShareNoNode) {
  ASSERT_GE(model.mass.size(), least_parted);
  ASSERT_EQ(springs.first.size(), 2 * n_parts + 1);
  EXPECT_EQ(springs.first.front(), 0);
  EXPECT_EQ(springs.first.back(), springs.E.cols());
  for (int first = 0, size = 8; size > 0; first += size, size /= 2) {
    std::set<int> taken;
    for (int part = first; part < first + size; ++part) {
      std::set<int> own;
      for (int k : {part, n_parts + part})
        for (int s = springs.first[k]; s < springs.first[k + 1]; ++s)
          own.insert({springs.E(0, s), springs.E(1, s)});
      for (int node : own) EXPECT_TRUE(taken.insert(node).second) << "node " << node << ", part " << part;
    }
  }
  int n_in_eighths = 0;
  for (int k : {0, n_parts}) n_in_eighths += springs.first[k + 8] - springs.first[k];
  EXPECT_GT(n_in_eighths, 0.7 * static_cast<double>(springs.E.cols()));
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

TEST_F(Parts, PutTheEdgesOfTheSurfaceFirst) {
  expect_surface_first(model);
}

// A skin stiffens the first springs.
TEST(Springs, OfTetrahedraHaveTheEdgesOfTheSurfaceFirst) {
  const TetMesh mesh = box_tets(3, 3, 3, 0.5);
  SpringNetwork network;
  network.X = mesh.X;
  network.F = mesh.F;
  network.T = mesh.T;
  network.n_surface = static_cast<int>(mesh.X.cols());
  MassSpringModel model = calibrate(network, Material{}, find_calibration("van_gelder"));
  expect_surface_first(model);
  Skin skin;
  skin.stiffness = 10;
  EXPECT_NO_THROW(add_skin(skin, model));
}

TEST_F(Parts, SumsHaveTheSameBitsOnAnyNumberOfThreads) {
  const SpringBlocks B = hessian(springs, state.rest_length, x);
  const auto sums = [&](int n_threads) {
    omp_set_num_threads(n_threads);
    Matrix3Xd f = Matrix3Xd::Ones(3, x.cols()), y = f;
    add_forces(springs, state.rest_length, x, f);
    add_product(springs, B, x, y);
    omp_set_num_threads(1);
    return std::pair(f, y);
  };
  const auto one = sums(1);
  Springs unparted = springs;
  unparted.first.clear();
  Matrix3Xd f = Matrix3Xd::Ones(3, x.cols());
  add_forces(unparted, state.rest_length, x, f);
  EXPECT_LT((one.first - f).norm(), 1e-13 * f.norm());
  for (int n_threads : {2, 3, 8}) {
    const auto many = sums(n_threads);
    EXPECT_EQ(one.first, many.first) << n_threads;
    EXPECT_EQ(one.second, many.second) << n_threads;
  }
}

TEST_F(Parts, ExplicitStepsOnAFloorHaveTheSameBitsOnOneThreadAndTwo) {
  Forces forces;
  forces.load = Eigen::Vector3d(0, -9.81, 0) * model.mass.transpose();
  forces.mass_damping = 1;
  forces.volume_pressure = 1e4;
  Obstacle floor;
  floor.shape = HalfSpace{{0, x.row(1).minCoeff(), 0}, {0, 1, 0}};
  forces.bodies.emplace_back(floor);
  const auto end_on = [&](int n_threads) {
    omp_set_num_threads(n_threads);
    State moved = state;
    moved.x = x;
    TimeStepper stepper(model, forces, Integrator::SymplecticEuler, 1);
    for (int n = 0; n < 20; ++n) EXPECT_EQ(stepper.step(moved, 1e-4).status, Status::Ok);
    omp_set_num_threads(1);
    return moved;
  };
  const State one = end_on(1), two = end_on(2);
  EXPECT_GT((one.x - x).norm(), 1e-3 * x.norm());
  EXPECT_EQ(one.x, two.x);
  EXPECT_EQ(one.v, two.v);
}

}  // namespace
}  // namespace testbed
