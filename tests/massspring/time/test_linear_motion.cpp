#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <tuple>

#include "massspring/time/constant_matrix.h"
#include "massspring/time/integrators.h"
#include "meshing/surface_energies/follower_pressure.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/linear_box.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kClose = 1e-9;  // of direct solves, over displacements

/// A box with consistent mass, damped; independent springs at nodes, damped along themselves.
struct Swinging {
  explicit Swinging(const std::string& calibration, bool is_consistent = true)
      : model(linear_box(calibration, 1)) {
    if (is_consistent && model.tet_springs)
      model.consistent_mass = consistent_mass(model.network.X, model.network.T, model.material.rho);
    if (model.springs) model.springs->damping = 3;  // N s/m
    forces = hanging(model);
    forces.mass_damping = 5;  // 1/s
    start = initial_state(model);
    start.x += random_points(static_cast<int>(start.x.cols()), 1e-3, 4);
    start.v = random_points(static_cast<int>(start.x.cols()), 0.1, 5);
    for (const Constraint& c : forces.constraints) {
      start.x.col(c.node) = model.network.X.col(c.node);
      start.v.col(c.node).setZero();
    }
  }
  MatrixXd mass() const {
    const Eigen::Index n = model.mass.size();
    MatrixXd M(3 * n, 3 * n);
    for (Eigen::Index k = 0; k < 3 * n; ++k) {
      Matrix3Xd e = Matrix3Xd::Zero(3, n);
      e(k) = 1;
      M.col(k) = momenta(model, e).reshaped();
    }
    return M;
  }
  MatrixXd damping() const {
    MatrixXd C = forces.mass_damping * mass();
    if (!model.springs) return C;
    BlockMatrix D = stiffness_pattern(model);
    add_blocks(*model.springs, damping_matrix(*model.springs, model.network.X), D);
    mirror(D);
    return C + dense(D);
  }
  MassSpringModel model;
  Forces forces;
  State start;
};

/// Steps of dense matrices on (u, v, 1), the unknowns that are free: d/dt of it is A times it.
class DenseScheme {
 public:
  DenseScheme(const Swinging& s, const std::string& integrator, double h) : integrator_(integrator), h_(h) {
    const Eigen::VectorXi free = free_unknowns(s.model, s.forces);
    const Eigen::Index n = free.size();
    const MatrixXd M = s.mass()(free, free), inverse = M.inverse();
    const VectorXd load = s.forces.load.reshaped()(free);
    A_ = MatrixXd::Zero(2 * n + 1, 2 * n + 1);
    A_.block(0, n, n, n).setIdentity();
    A_.block(n, 0, n, n) = -inverse * dense_stiffness(s.model)(free, free);
    A_.block(n, n, n, n) = -inverse * s.damping()(free, free);
    A_.col(2 * n).segment(n, n) = inverse * load;
    y_ = VectorXd::Ones(2 * n + 1);
    y_.head(n) = (s.start.x - s.model.network.X).reshaped()(free);
    y_.segment(n, n) = s.start.v.reshaped()(free);
  }

  void step() {
    const MatrixXd I = MatrixXd::Identity(A_.rows(), A_.rows()), B = h_ * A_;
    const VectorXd before = y_;
    const double g = 2 - std::sqrt(2.), old = 1 / (g * (2 - g));
    if (integrator_ == "rk4") {
      y_ = (I + B + B * B / 2 + B * B * B / 6 + B * B * B * B / 24) * y_;
    } else if (integrator_ == "explicit_euler") {
      y_ = (I + B) * y_;
    } else if (integrator_ == "symplectic_euler") {
      const Eigen::Index n = y_.size() / 2;
      y_.segment(n, n) += (B * y_).segment(n, n);
      y_.head(n) += h_ * y_.segment(n, n);
    } else if (integrator_ == "midpoint") {
      y_ = (I - B / 2).lu().solve((I + B / 2) * y_);
    } else if (integrator_ == "tr_bdf2") {
      const MatrixXd stage = (I - g / 2 * B).inverse();
      y_ = stage * (old * stage * (I + g / 2 * B) * y_ + (1 - old) * y_);
    } else if (integrator_ == "bdf2" && before_.size() > 0) {
      const VectorXd known = (4 * y_ - before_) / 3;
      y_ = (I - 2. / 3 * B).lu().solve(known);
    } else {  // both of Euler's implicit steps, and the first of BDF2
      y_ = (I - B).lu().solve(y_);
    }
    before_ = before;
  }

  VectorXd u() const { return y_.head(y_.size() / 2); }
  VectorXd v() const { return y_.segment(y_.size() / 2, y_.size() / 2); }

 private:
  std::string integrator_;
  double h_;
  MatrixXd A_;
  VectorXd y_, before_;
};

TEST(LinearMotion, StepsOfEverySchemeAreThoseOfDenseMatrices) {
  for (const char* calibration : {"edge_coupled", "node_averaged", "van_gelder"})
    for (const Integrator& integrator : integrators()) {
      const Swinging s(calibration, !integrator.is_explicit);
      const double h = integrator.is_explicit ? stable_step(s.model, s.forces, s.start) / 4 : 0.01;
      DenseScheme dense(s, integrator.name, h);
      TimeStepper stepper(s.model, s.forces, integrator.name, 1);
      const Eigen::VectorXi free = free_unknowns(s.model, s.forces);
      State state = s.start;
      for (int n = 0; n < 4; ++n) {
        ASSERT_EQ(stepper.step(state, h).status, Status::Ok);
        dense.step();
      }
      const VectorXd u = (state.x - s.model.network.X).reshaped()(free), v = state.v.reshaped()(free);
      EXPECT_LT((u - dense.u()).norm(), kClose * u.norm()) << calibration << ' ' << integrator.name;
      EXPECT_LT((v - dense.v()).norm(), kClose * v.norm()) << calibration << ' ' << integrator.name;
      for (const Constraint& c : s.forces.constraints)
        EXPECT_EQ(state.x.col(c.node), s.model.network.X.col(c.node));
    }
}

/// Supports that move at a speed of their own carry the body: seen from them it is at rest.
TEST(LinearMotion, SupportsThatMoveCarryTheBody) {
  for (const char* integrator : {"implicit_euler", "minimising_euler", "midpoint", "bdf2", "tr_bdf2"}) {
    Swinging still("node_averaged"), moved = still;
    still.forces.mass_damping = moved.forces.mass_damping = 0;
    const Eigen::Vector3d speed(0.1, -0.2, 0.3);
    for (Constraint& c : moved.forces.constraints) c.displacement = speed;  // in a second
    moved.start.v.colwise() += speed;
    TimeStepper a(still.model, still.forces, integrator, 1), b(moved.model, moved.forces, integrator, 1);
    for (int n = 0; n < 5; ++n) {
      ASSERT_EQ(a.step(still.start, 0.02).status, Status::Ok);
      ASSERT_EQ(b.step(moved.start, 0.02).status, Status::Ok);
    }
    const Matrix3Xd expected = still.start.x.colwise() + 0.1 * speed;
    EXPECT_LT((moved.start.x - expected).norm(), 1e-11) << integrator;
  }
}

TEST(LinearMotion, MidpointKeepsTheEnergyOfAFreeBodyToRounding) {
  for (const char* calibration : {"node_averaged", "van_gelder"}) {
    Swinging s(calibration);
    if (s.model.springs) s.model.springs->damping = 0;
    const Forces forces = no_forces(s.model);
    const auto energy = [&](const State& state) {
      return elastic_energy(s.model, state) + kinetic_energy(s.model, state.v);
    };
    const double before = energy(s.start);
    TimeStepper stepper(s.model, forces, "midpoint", 1);
    for (int n = 0; n < 100; ++n) ASSERT_EQ(stepper.step(s.start, 0.01).status, Status::Ok);
    EXPECT_NEAR(energy(s.start), before, 1e-11 * before) << calibration;
  }
}

TEST(LinearMotion, ErrorsFallWithTheOrderOfTheScheme) {
  for (const Integrator& integrator : integrators()) {
    if (integrator.is_explicit) continue;
    Swinging s("edge_coupled");
    const auto end = [&](int n_steps) {
      TimeStepper stepper(s.model, s.forces, integrator.name, 1);
      State state = initial_state(s.model);
      for (int n = 0; n < n_steps; ++n) stepper.step(state, 0.01 / n_steps);
      return state.x;
    };
    const Matrix3Xd exact = end(2048);
    const double ratio = (end(64) - exact).norm() / (end(128) - exact).norm();
    EXPECT_NEAR(std::log2(ratio), integrator.order, 0.25) << integrator.name;
  }
}

TEST(LinearMotion, IsThatOfFullGeometryAsItVanishes) {
  for (const char* integrator : {"implicit_euler", "midpoint", "bdf2"}) {
    const auto difference = [&](double gravity) {
      MassSpringModel linear = linear_box("node_averaged", 1), full = full_box("node_averaged", 1);
      const Forces forces = hanging(linear, gravity);
      State a = initial_state(linear), b = a;
      TimeStepper one(linear, forces, integrator, 1), other(full, forces, integrator, 1, {1e-13});
      for (int n = 0; n < 8; ++n) {
        EXPECT_EQ(one.step(a, 0.01).status, Status::Ok);
        EXPECT_EQ(other.step(b, 0.01).status, Status::Ok);
      }
      return (a.x - b.x).norm();
    };
    EXPECT_NEAR(difference(20) / difference(10), 4, 0.4) << integrator;
  }
}

TEST(LinearMotion, TakesOneFactorForItsStepsAndAnotherWhereTheirLengthChanges) {
  Swinging s("node_averaged");
  TimeStepper stepper(s.model, s.forces, "midpoint", 1);
  State state = s.start, other = s.start;
  for (const double h : {0.01, 0.01, 0.02, 0.005}) {
    const StepReport report = stepper.step(state, h);
    EXPECT_EQ(report.newton_iterations, 1);
    EXPECT_EQ(report.linear_iterations, 0);
    TimeStepper fresh(s.model, s.forces, "midpoint", 1);
    fresh.step(other, h);
    EXPECT_EQ(state.x, other.x) << h;
  }
  EXPECT_EQ(stepper.solver_choice().substr(0, 15), "Cholesky factor");
}

TEST(LinearMotion, MatrixIsSolvedWithByItsFactorOrByIterations) {
  const Swinging s("node_averaged");
  const EquationOfMotion motion(s.model, s.forces);
  ImplicitMatrix A(motion);
  LinearSolver iterations;
  const ImplicitMatrix::Factors factors{3e4, 1, 1e2};
  const Eigen::VectorXi free = free_unknowns(s.model, s.forces);
  const MatrixXd dense_A = (3e4 * s.mass() + dense_stiffness(s.model))(free, free);
  Matrix3Xd b = random_points(static_cast<int>(s.model.mass.size()), 1, 6), x;
  filter(s.forces.constraints, b);
  const VectorXd expected = dense_A.lu().solve(b.reshaped()(free).eval());
  for (const auto& [keeps_step, most_blocks, choice] :
       {std::tuple(true, 800'000, "Cholesky"), {true, 0, "block Jacobi"}, {false, 800'000, "block Jacobi"}}) {
    ConstantMatrix matrix(motion, A, iterations, keeps_step, most_blocks);
    EXPECT_TRUE(matrix.solve(factors, b, x).is_converged);
    EXPECT_LT((x.reshaped()(free) - expected).norm(), kClose * expected.norm()) << choice;
    EXPECT_EQ(matrix.choice().rfind(choice, 0), 0u) << matrix.choice();
  }
}

TEST(LinearMotion, StepsWhoseLengthAdaptsAreSolvedByIterations) {
  Swinging s("node_averaged");
  IntegratorOptions adaptive;
  adaptive.tolerance = 1e-6;
  TimeStepper in_parts(s.model, s.forces, "midpoint", 1, adaptive), fine(s.model, s.forces, "midpoint", 1);
  State state = s.start, exact = s.start;
  const StepReport report = in_parts.step(state, 0.05);
  EXPECT_EQ(report.status, Status::Ok);
  EXPECT_GT(report.linear_iterations, 0);
  for (int n = 0; n < 2000; ++n) fine.step(exact, 0.05 / 2000);
  EXPECT_LT((state.x - exact.x).colwise().norm().maxCoeff(), 1e-4);
}

TEST(LinearMotion, BodyThatStaysSlowIsNotStepped) {
  const MassSpringModel model = linear_box("node_averaged", 1);
  const Forces forces = no_forces(model);
  IntegratorOptions sleeping;
  sleeping.sleep_below = 0.01;
  TimeStepper stepper(model, forces, "midpoint", 1, sleeping);
  State state = initial_state(model);
  EXPECT_TRUE(stepper.step(state, 0.01).is_at_rest);
  state.x *= 1.01;
  EXPECT_FALSE(stepper.step(state, 0.01).is_at_rest) << "its springs would move it";
}

TEST(LinearMotion, IsWhereNothingButLinearForcesActs) {
  const MassSpringModel linear = linear_box("edge_coupled", 1), full = full_box("edge_coupled", 1);
  const Forces dead = no_forces(linear);
  Forces following = dead, bagged = dead;
  following.surface.push_back(std::make_shared<FollowerPressure>(1, Faces{linear.network.F}));
  add_volume_penalty(1, linear, bagged);
  EXPECT_TRUE(is_linear(EquationOfMotion(linear, dead)));
  EXPECT_FALSE(is_linear(EquationOfMotion(full, dead)));
  EXPECT_FALSE(is_linear(EquationOfMotion(linear, following)));
  EXPECT_FALSE(is_linear(EquationOfMotion(linear, bagged)));
}

}  // namespace
}  // namespace testbed::massspring
