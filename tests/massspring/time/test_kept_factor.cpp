// The kept factor against dense solves and against Newton's method with a matrix in every iteration.
#include <gtest/gtest.h>

#include <Eigen/LU>

#include "massspring/time/implicit_stage.h"
#include "massspring/time/integrators.h"
#include "massspring/time/kept_factor.h"
#include "tests/massspring/dense.h"
#include "tests/massspring/linear_box.h"
#include "tests/massspring/small_network.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

constexpr double kSingle = 1e-5;  // of a solve with a factor in single precision

/// A matrix at rest, and how often it was set.
struct Kept {
  explicit Kept(const std::string& calibration, bool keeps_step = true)
      : Kept(full_box(calibration, 1), keeps_step) {}
  explicit Kept(const MassSpringModel& body, bool keeps_step = true)
      : model(body), forces(hanging(model)), motion(model, forces), A(motion), factor(motion, keeps_step) {}
  bool solve(const Matrix3Xd& r, Matrix3Xd& dx, double inertia = 3e4) {
    const ImplicitMatrix::Factors factors{inertia, 1, 0};
    const State rest = initial_state(model);
    return factor.solve(
        r, factors,
        [&](Curvature curvature) {
          A.set(rest, rest.x, factors, curvature);
          ++n_set;
        },
        A, dx);
  }
  Matrix3Xd residual(double size) const {
    Matrix3Xd r = random_points(static_cast<int>(model.mass.size()), size, 6);
    filter(forces.constraints, r);
    return r;
  }
  MassSpringModel model;
  Forces forces;
  EquationOfMotion motion;
  ImplicitMatrix A;
  KeptFactor factor;
  int n_set = 0;
};

TEST(KeptFactor, SolvesAsADenseMatrixWhateverTheSize) {
  Kept kept("node_averaged");
  const Eigen::VectorXi free = free_unknowns(kept.model, kept.forces);
  const Eigen::MatrixXd A =
      (dense_stiffness(kept.model) +
       3e4 * kept.model.mass.transpose().replicate(3, 1).reshaped().asDiagonal().toDenseMatrix())(free, free);
  for (double size : {1e-30, 1., 1e30}) {
    kept.factor.begin();
    const Matrix3Xd r = kept.residual(size);
    Matrix3Xd dx;
    ASSERT_TRUE(kept.solve(r, dx));
    const Eigen::VectorXd expected = A.lu().solve(r.reshaped()(free).eval());
    EXPECT_LT((dx.reshaped()(free) - expected).norm(), kSingle * expected.norm()) << size;
    for (const Constraint& c : kept.forces.constraints) EXPECT_EQ(dx.col(c.node).norm(), 0);
  }
  EXPECT_EQ(kept.n_set, 1);
}

TEST(KeptFactor, IsMadeAnewWhereGradientsFallSlowlyAndOnceAStep) {
  Kept kept("edge_coupled");
  Matrix3Xd dx;
  kept.factor.begin();
  EXPECT_TRUE(kept.solve(kept.residual(1), dx));
  kept.factor.begin();
  for (double size : {1., 0.29, 0.08}) EXPECT_TRUE(kept.solve(kept.residual(size), dx));
  EXPECT_EQ(kept.n_set, 1);
  EXPECT_TRUE(kept.solve(kept.residual(0.03), dx));
  EXPECT_EQ(kept.n_set, 2);
  EXPECT_FALSE(kept.solve(kept.residual(0.02), dx)) << "a new one that does no better";
  EXPECT_FALSE(kept.solve(kept.residual(1e-6), dx)) << "the step is left to others";
  kept.factor.begin();
  EXPECT_TRUE(kept.solve(kept.residual(1), dx, 2e4)) << "of other steps";
  EXPECT_EQ(kept.n_set, 3);
}

TEST(KeptFactor, IsGivenUpAfterManyStepsInVain) {
  Kept kept("edge_coupled");
  Matrix3Xd dx;
  for (int step = 0; step < 100; ++step) {
    kept.factor.begin();
    for (double size : {1., 0.9, 0.8}) kept.solve(kept.residual(size), dx);
  }
  EXPECT_GE(kept.n_set, 5);
  EXPECT_LE(kept.n_set, 10);
  EXPECT_FALSE(kept.factor.is_in_use());
}

TEST(KeptFactor, LeavesSpringsAloneAndStepsOfManyLengthsToOthers) {
  Kept springs(small_model()), many("node_averaged", false);
  for (Kept* kept : {&springs, &many}) {
    Matrix3Xd dx;
    kept->factor.begin();
    EXPECT_FALSE(kept->solve(kept->residual(1), dx));
    EXPECT_EQ(kept->n_set, 0);
  }
}

// Steps of many lengths take a matrix in every iteration.
TEST(ImplicitStage, FindsTheSameStepsByAFactorThatItKeeps) {
  constexpr double h = 0.004;
  for (const char* calibration : {"edge_coupled", "node_averaged"}) {
    const MassSpringModel model = full_box(calibration, 1, 2e4);
    const Forces forces = hanging(model);
    EquationOfMotion motion(model, forces);
    motion.constraints = forces.constraints;
    ImplicitStage keeping(motion, true, 1e-10), renewing(motion, false, 1e-10);
    State kept = initial_state(model), renewed = kept;
    const auto step = [&](ImplicitStage& stage, State& state) {
      Matrix3Xd x, v;
      const StepReport report = stage.solve(state, h, state.x, state.v, x, v);
      EXPECT_EQ(report.status, Status::Ok);
      state.x = x;
      state.v = v;
      return report.linear_iterations;
    };
    int n_of_keeping = 0, n_of_renewing = 0;
    for (int n = 0; n < 50; ++n) {
      n_of_keeping += step(keeping, kept);
      n_of_renewing += step(renewing, renewed);
    }
    const double moved = displacement(model, renewed).norm();
    EXPECT_GT(moved, 0.1 * model.network.X.norm());
    EXPECT_LT((kept.x - renewed.x).norm(), 1e-6 * moved) << calibration;
    EXPECT_EQ(n_of_keeping, 0);
    EXPECT_GT(n_of_renewing, 0);
  }
}

TEST(ImplicitStage, EndsAStepAtTheResidualThatIsAskedFor) {
  constexpr double h = 0.004, kLoose = 1e-3;
  const MassSpringModel model = full_box("edge_coupled", 1, 2e4);
  const Forces forces = hanging(model);
  EquationOfMotion motion(model, forces);
  motion.constraints = forces.constraints;
  const auto move = [&](double residual, int& n_iterations) {
    ImplicitStage stage(motion, true, residual);
    State state = initial_state(model);
    for (int n = 0; n < 50; ++n) {
      Matrix3Xd x, v;
      const StepReport report = stage.solve(state, h, state.x, state.v, x, v);
      EXPECT_TRUE(report.residual <= residual || residual < kLoose);  // or ended by its last correction
      n_iterations += report.newton_iterations;
      state.x = x;
      state.v = v;
    }
    return state.x;
  };
  int n_loose = 0, n_tight = 0;
  const Matrix3Xd loose = move(kLoose, n_loose), tight = move(1e-9, n_tight);
  EXPECT_LT(2 * n_loose, n_tight);
  const double difference = (loose - tight).norm() / (tight - model.network.X).norm();
  EXPECT_LT(difference, kLoose);
  EXPECT_GT(difference, 1e-3 * kLoose);
}

}  // namespace
}  // namespace testbed::massspring
