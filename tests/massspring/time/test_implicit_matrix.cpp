#include <gtest/gtest.h>

#include "massspring/time/implicit_matrix.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "tests/massspring/linear_box.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kRounding = 1e-12;

Forces some_constraints(const MassSpringModel& model) {
  Forces forces = no_forces(model);
  const Eigen::Vector3d p = Eigen::Vector3d(1, 2, -2) / 3;
  forces.constraints.push_back({0, Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  forces.constraints.push_back({3, Eigen::Matrix3d::Identity() - p * p.transpose(), Eigen::Vector3d::Zero()});
  return forces;
}

MassSpringModel damped_springs() {
  MassSpringModel model = small_model();
  model.springs->damping = 3;
  return model;
}

/// Their matrix is formed in blocks instead of spring by spring.
MassSpringModel damped_springs_in_blocks() {
  MassSpringModel model = damped_springs();
  model.local_volume = LocalVolume{50, Eigen::Vector4i(0, 1, 2, 3), Eigen::VectorXd::Constant(1, 1. / 6)};
  return model;
}

TEST(ImplicitMatrix, AppliesOnFreeDirectionsWhatItWouldForm) {
  MassSpringModel model = small_model();
  model.springs->damping = 3;
  const Forces forces = some_constraints(model);
  const EquationOfMotion motion(model, forces);
  State state = initial_state(model);
  state.x *= 0.8;
  ImplicitMatrix A(motion);
  A.set(state, 1.2 * state.x, {2, 0.3, 0.1}, Curvature::Projected);
  Matrix3Xd p = random_points(5, 1, 6), y, expected;
  filter(forces.constraints, p);
  A.multiply(p, y);
  multiply(A.system().matrix(), p, expected);
  ASSERT_GT(y.norm(), 1);
  EXPECT_LT((y - expected).norm(), kRounding * y.norm());
}

TEST(ImplicitMatrix, IsTheDerivativeOfTheForcesOfAStep) {
  for (const MassSpringModel& model : {damped_springs(), damped_springs_in_blocks()}) {
    Forces forces = some_constraints(model);
    add_volume_penalty(70, model, forces);
    forces.surface.push_back(std::make_shared<FollowerPressure>(40, Faces{model.network.F}));
    const EquationOfMotion motion(model, forces);
    State state =
        initial_state(model);  // at its target volume, where the Hessian of the volume force has rank one
    state.v = random_points(5, 1, 4);
    constexpr double m = 2, k = 0.3, d = 0.1, kStep = 1e-6, kDifferenceTolerance = 1e-7;
    ImplicitMatrix A(motion);
    A.set(state, state.x, {m, k, d}, Curvature::Exact);
    Matrix3Xd p = random_points(5, 1, 6), y, f[2][2];
    filter(forces.constraints, p);
    A.multiply(p, y);
    for (int side : {0, 1}) {
      State moved = state;
      moved.x += (side ? kStep : -kStep) * p;
      undamped_forces(model, forces, moved, f[0][side]);
      moved = state;
      moved.v += (side ? kStep : -kStep) * p;
      motion.forces_at(moved, f[1][side]);
    }
    Matrix3Xd expected =
        m * p * model.mass.asDiagonal() - (k * (f[0][1] - f[0][0]) + d * (f[1][1] - f[1][0])) / (2 * kStep);
    filter(forces.constraints, expected);
    ASSERT_GT(y.norm(), 1);
    EXPECT_LT((y - expected).norm(), kDifferenceTolerance * y.norm());
  }
}

TEST(ImplicitMatrix, OfALinearModelOfCoupledSpringsIsTheSameWhetherFormedOrNot) {
  MassSpringModel model = full_box("node_averaged", 2);
  model.consistent_mass = consistent_mass(model.network.X, model.network.T, 1000);
  linearise(model);
  const int n = static_cast<int>(model.mass.size());
  const Forces forces = hanging(model);
  const EquationOfMotion motion(model, forces);
  ImplicitMatrix A(motion);
  const State rest = initial_state(model);
  A.set(rest, rest.x, {2, 1e-4, 1}, Curvature::Exact);
  Matrix3Xd p = random_points(n, 1, 6), y, expected;
  filter(forces.constraints, p);
  A.multiply(p, y);
  LinearSystem system = A.system();
  const BlockMatrix& formed = A.matrix();
  meshing::multiply(formed, p, expected);
  EXPECT_LT((y - expected).norm(), 1e-13 * expected.norm());

  PaddedField single, single_y;
  meshing::pad(p, 1, single);
  const double p_Ap = system.single_product(single, single_y);
  EXPECT_LT((single_y.topLeftCorner(3, n).cast<double>() - expected).norm(), 1e-6 * expected.norm());
  EXPECT_NEAR(p_Ap, p.cwiseProduct(expected).sum(), 1e-6 * p_Ap);

  std::vector<Eigen::Matrix3d> blocks;
  system.diagonal(blocks);
  std::vector<char> is_constrained(n, 0);
  for (const Constraint& c : forces.constraints) is_constrained[c.node] = 1;
  for (int i = 0; i < n; ++i)
    if (!is_constrained[i]) {
      EXPECT_LT((blocks[i] - formed.block[formed.diagonal[i]]).norm(), 1e-13 * blocks[i].norm());
    }
}

TEST(ImplicitMatrix, OfManyNodesIsPreconditionedByThePartsOfTetrahedraThatAveragesLeave) {
  MassSpringModel model = full_box("node_averaged", 13);
  ASSERT_GT(model.mass.size(), 5000);
  model.consistent_mass = consistent_mass(model.network.X, model.network.T, 1000);
  linearise(model);
  const Forces forces = no_forces(model);
  const EquationOfMotion motion(model, forces);
  ImplicitMatrix A(motion);
  const State rest = initial_state(model);
  constexpr double kStiffness = 1e-4;
  A.set(rest, rest.x, {2, kStiffness, 1}, Curvature::Exact);
  const BlockMatrix& P = A.system().matrix();
  EXPECT_LT(P.block.size(), model.mass.size() * 20);
  const Matrix3Xd p = (Eigen::Matrix3d() << 1, 2, -1, 0, 3, 1, 2, 0, -2).finished() * model.network.X;
  const auto& [X, T, F, n_surface] = model.network;
  const Eigen::RowVectorXd others = 1 - parts_left_by_averages(X, T).array();
  Matrix3Xd Ap, Pp, of_others;
  A.multiply(p, Ap);
  meshing::multiply(P, p, Pp);
  meshing::multiply(stiffness_of_tetrahedra(X, T, lame_of(model.material), others), p, of_others);
  const double p_Ap = p.cwiseProduct(Ap).sum(), left_out = kStiffness * p.cwiseProduct(of_others).sum();
  ASSERT_GT(left_out, 0.01 * p_Ap);
  EXPECT_NEAR(p.cwiseProduct(Pp).sum(), p_Ap - left_out, 1e-10 * p_Ap)
      << "averages bear linear fields as tetrahedra do";
}

/// Two triangles whose edges touch each other, and a node that touches the floor.
struct TwoContacts {
  MassSpringModel model = crossing_triangles(0.07, 2);  // so nearly parallel that their contact is smoothed
  Forces forces = no_forces(model);
  Contacts contacts;
  std::optional<EquationOfMotion> motion;
  State state = initial_state(model);

  explicit TwoContacts(bool has_barriers = true) {
    constexpr double kThickness = 0.05, kRange = 1e-3;  // the barrier's is some 5e-3
    contacts.self_thickness = kThickness;
    Obstacle floor;
    floor.shape = HalfSpace{{0, 0, -1 - kRange}, {0, 0, 1}};
    contacts.bodies.emplace_back(floor);
    motion.emplace(model, forces, contacts);
    if (has_barriers) motion->add_barriers();
    state.x.leftCols(3).row(2).array() -= 2 - 0.8 * kThickness;
    for (const auto& energy : motion->surface()) energy->begin_step(0, 1, state.x);
  }
};

// Along the common normal of both edges their contact is a spring; what turns them towards it is left out, a ten
// thousandth of the whole for pairs that lie askew.
TEST(ImplicitMatrix, IsTheDerivativeOfTheForcesOfContactsToo) {
  const TwoContacts touching;
  constexpr double m = 2, k = 0.3, kStep = 1e-8, kDifferenceTolerance = 1e-4;
  ImplicitMatrix A(*touching.motion);
  const State& state = touching.state;
  A.set(state, state.x, {m, k, 0}, Curvature::Exact);
  for (const auto& [upper, lower] : {std::pair(1., 0.), std::pair(0., 1.), std::pair(0.5, 0.3)}) {
    Matrix3Xd p = Matrix3Xd::Zero(3, 6), y, f[2];
    p.leftCols(3).row(2).setConstant(upper);
    p.rightCols(3).row(2).setConstant(lower);
    A.multiply(p, y);
    for (int side : {0, 1}) {
      State moved = state;
      moved.x += (side ? kStep : -kStep) * p;
      touching.motion->undamped_forces_at(moved, f[side]);
    }
    ASSERT_GT((f[1] - f[0]).leftCols(3).norm(), 1e-7);
    const Matrix3Xd expected = m * p * touching.model.mass.asDiagonal() - k * (f[1] - f[0]) / (2 * kStep);
    EXPECT_LT((y - expected).row(2).norm(), kDifferenceTolerance * y.norm()) << upper << ' ' << lower;
  }
}

TEST(ImplicitMatrix, DiagonalAndSinglePrecisionAreThoseOfTheProductWithContactsToo) {
  constexpr double kSingleRounding = 1e-6;
  TwoContacts springs, coupled, of_penalty(false);
  springs.model.springs->damping = 3;
  coupled.model.local_volume = LocalVolume{50, Eigen::Vector4i(0, 1, 2, 5), Eigen::VectorXd::Constant(1, 1.)};
  coupled.model.springs->damping = 3;
  for (const TwoContacts* touching : {&springs, &coupled, &of_penalty}) {
    ImplicitMatrix A(*touching->motion);
    const State& state = touching->state;
    A.set(state, state.x, {2, 0.3, 0.1}, Curvature::Projected);
    const LinearSystem system = A.system();
    std::vector<Eigen::Matrix3d> diagonal;
    system.diagonal(diagonal);
    for (int i = 0; i < 6; ++i)
      for (int c = 0; c < 3; ++c) {
        Matrix3Xd p = Matrix3Xd::Zero(3, 6), y;
        p(c, i) = 1;
        A.multiply(p, y);
        EXPECT_LT((diagonal[i].col(c) - y.col(i)).norm(), kRounding * y.norm()) << i << ' ' << c;
        PaddedField single_p, single_y;
        pad(p, 1, single_p);
        system.single_product(single_p, single_y);
        Matrix3Xd y_of_single = Matrix3Xd::Zero(3, 6);
        add_unpadded(single_y, 1, y_of_single);
        EXPECT_LT((y_of_single - y).norm(), kSingleRounding * y.norm());
      }
  }
}

TEST(ImplicitMatrix, IsInSinglePrecisionTheSameToItsRounding) {
  constexpr double kSingleRounding = 1e-6;
  for (const MassSpringModel& model : {damped_springs(), damped_springs_in_blocks()}) {
    Forces forces = some_constraints(model);
    add_volume_penalty(70, model, forces);
    forces.surface.push_back(std::make_shared<FollowerPressure>(40, Faces{model.network.F}));
    const EquationOfMotion motion(model, forces);
    State state = initial_state(model);
    state.x *= 0.8;
    ImplicitMatrix A(motion);
    A.set(state, state.x, {2, 0.3, 0.1}, Curvature::Exact);
    Matrix3Xd p = random_points(5, 1, 6), y, y_of_single;
    filter(forces.constraints, p);
    PaddedField single_p, single_y;
    pad(p, 1, single_p);
    const LinearSystem system = A.system();
    system.product(p, y);
    const double p_y = system.single_product(single_p, single_y);
    y_of_single = Matrix3Xd::Zero(3, 5);
    add_unpadded(single_y, 1, y_of_single);
    ASSERT_GT(y.norm(), 1);
    EXPECT_LT((y_of_single - y).norm(), kSingleRounding * y.norm());
    EXPECT_NEAR(p_y, p.cwiseProduct(y).sum(), kSingleRounding * p.norm() * y.norm());
    EXPECT_EQ(single_y.row(3).norm() + single_y.rightCols(3).norm(), 0);
  }
}

}  // namespace
}  // namespace testbed::massspring
