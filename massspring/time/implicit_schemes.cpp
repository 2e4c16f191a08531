// Implicit schemes as sequences of stages v = w + a M^-1 f(x, v), x = y + a v.
#include <algorithm>
#include <cmath>

#include "massspring/time/implicit_stage.h"
#include "massspring/time/schemes.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;

class StagedScheme : public Scheme {
 public:
  StagedScheme(EquationOfMotion& motion, const IntegratorOptions& options)
      : motion_(motion), stage_(motion, options.tolerance == 0, options.residual) {}
  std::string solver_choice() const override { return stage_.solver_choice(); }
  void archive_kept(Archive& a) override { a(stage_); }

 protected:
  EquationOfMotion& motion_;
  ImplicitStage stage_;
};

StepReport sum(StepReport first, const StepReport& second) {
  first.status = std::max(first.status, second.status);
  first.newton_iterations += second.newton_iterations;
  first.linear_iterations += second.linear_iterations;
  first.residual = std::max(first.residual, second.residual);
  return first;
}

/// x_1 = x_0 + h v_1, v_1 = v_0 + h M^-1 f_1. First order, never gains energy.
class MinimisingEuler : public StagedScheme {
 public:
  using StagedScheme::StagedScheme;
  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    return stage_.solve(state, h, state.x, state.v, x, v);
  }
};

/// Half a step of implicit Euler, then the same once more without solving. Second order, keeps quadratic
/// invariants.
class Midpoint : public StagedScheme {
 public:
  using StagedScheme::StagedScheme;
  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    const StepReport report = stage_.solve(state, h / 2, state.x, state.v, x, v);
    x = 2 * x - state.x;
    v = 2 * v - state.v;
    return report;
  }
};

/// x_1 = 4/3 x_0 - 1/3 x_-1 + 2/3 h v_1, v_1 likewise; its first step, and one of another length, by implicit
/// Euler. Second order [Gear 1971].
class Bdf2 : public StagedScheme {
 public:
  using StagedScheme::StagedScheme;
  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    const StepHistory& before = state.history;
    const bool has_history = before.x.cols() == state.x.cols() && std::abs(state.t - before.t - h) < 1e-9 * h;
    return has_history ? stage_.solve(state, 2 * h / 3, (4 * state.x - before.x) / 3,
                                      (4 * state.v - before.v) / 3, x, v)
                       : stage_.solve(state, h, state.x, state.v, x, v);
  }
};

/// Trapezoidal rule to t + gamma h, then BDF2 over both parts; gamma = 2 - sqrt(2) gives both the same
/// matrix. Second order, L-stable [Bank et al. 1985]. A step in which contact acts is one of implicit Euler: the
/// trapezoidal rule holds a node where it touches by turning its velocity round.
class TrBdf2 : public StagedScheme {
 public:
  using StagedScheme::StagedScheme;
  StepReport advance(const State& state, double h, Matrix3Xd& x, Matrix3Xd& v) override {
    const double gamma = 2 - std::sqrt(2.0), a = gamma * h / 2, old = 1 / (gamma * (2 - gamma));
    StepReport report;
    bool is_touching = touches(state.x);
    if (!is_touching) {
      State middle = state;
      report = stage_.solve(state, a, state.x + a * state.v, state.v + a * acceleration(state), middle.x,
                            middle.v);
      is_touching = touches(middle.x);
      if (!is_touching) {
        report = sum(report, stage_.solve(middle, a, old * middle.x + (1 - old) * state.x,
                                          old * middle.v + (1 - old) * state.v, x, v));
        is_touching = touches(x);
      }
    }
    if (!is_touching) return report;
    report.status = Status::Ok;
    return sum(report, stage_.solve(state, h, state.x, state.v, x, v));
  }

 private:
  bool touches(const Matrix3Xd& x) const {
    return std::any_of(motion_.touching.begin(), motion_.touching.end(),
                       [&](const auto& energy) { return energy->stored(x) > 0; });
  }

  /// M^-1 f on the free directions.
  Matrix3Xd acceleration(const State& state) const {
    constexpr double kTolerance = 1e-13;
    constexpr int kMaxIterations = 200;
    const Eigen::VectorXd inverse_mass = motion_.model.mass.cwiseInverse();
    Matrix3Xd f;
    motion_.forces_at(state, f);
    filter(motion_.constraints, f);
    Matrix3Xd a = f * inverse_mass.asDiagonal();
    if (!motion_.model.consistent_mass) return a;
    const auto product = [&](const Matrix3Xd& p, Matrix3Xd& y) {
      y = momenta(motion_.model, p);
      filter(motion_.constraints, y);
    };
    const auto precondition = [&](const Matrix3Xd& r, Matrix3Xd& z) { z = r * inverse_mass.asDiagonal(); };
    conjugate_gradients(product, precondition, f, a, kTolerance, kMaxIterations);
    return a;
  }
};

}  // namespace

std::unique_ptr<Scheme> make_minimising_euler(EquationOfMotion& motion, const IntegratorOptions& options) {
  return std::make_unique<MinimisingEuler>(motion, options);
}
std::unique_ptr<Scheme> make_midpoint(EquationOfMotion& motion, const IntegratorOptions& options) {
  return std::make_unique<Midpoint>(motion, options);
}
std::unique_ptr<Scheme> make_bdf2(EquationOfMotion& motion, const IntegratorOptions& options) {
  return std::make_unique<Bdf2>(motion, options);
}
std::unique_ptr<Scheme> make_tr_bdf2(EquationOfMotion& motion, const IntegratorOptions& options) {
  return std::make_unique<TrBdf2>(motion, options);
}

}  // namespace testbed::massspring
