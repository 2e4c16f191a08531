#include "massspring/time/implicit_stage.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "massspring/algebra/rigid_motion.h"
#include "meshing/surface/surface.h"

namespace testbed::massspring {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

namespace {

/// Takes the turn in a straight step from `before` to x round its circle. Straight, it would also stretch a
/// stiff body, which Newton's method then turns in thousands of small steps.
void bend(const SmallRotation& turn, double step, const Matrix3Xd& before, Matrix3Xd& x) {
  const Vector3d angle = step * turn.angle;
  const double size = angle.norm();
  if (!(size > 0)) return;
  const Matrix3d R = Eigen::AngleAxisd(size, angle / size).toRotationMatrix();
  for (Eigen::Index i = 0; i < x.cols(); ++i) {
    const Vector3d d = before.col(i) - turn.centre;
    x.col(i) += R * d - d - angle.cross(d);
  }
}

}  // namespace

ImplicitStage::ImplicitStage(Motion& motion)
    : motion_(motion),
      A_(motion),
      size_(
          (motion.model.network.X.rowwise().maxCoeff() - motion.model.network.X.rowwise().minCoeff()).norm()),
      energy_scale_(motion.model.material.E * volume(motion.model.network.X, motion.model.network.F)) {}

double ImplicitStage::objective(const State& trial, const Matrix3Xd& start_x, double a,
                                const Matrix3Xd& w) const {
  const MassSpringModel& model = motion_.model;
  double sum = kinetic_energy(model, trial.v - w) + motion_.potential(trial);
  if (motion_.forces.mass_damping > 0)
    sum += a * motion_.forces.mass_damping * kinetic_energy(model, trial.v);
  if (model.springs && model.springs->damping > 0)
    sum += a * damping_power(*model.springs, start_x, trial.v) / 2;
  return sum;
}

void ImplicitStage::negative_gradient(const State& trial, const Matrix3Xd& start_x, double a,
                                      const Matrix3Xd& w, Matrix3Xd& r) const {
  const MassSpringModel& model = motion_.model;
  motion_.undamped_forces_at(trial, r);
  motion_.add_spring_damping(start_x, trial.v, r);
  r -= momenta(model, (trial.v - w) / a + motion_.forces.mass_damping * trial.v);
  filter(motion_.constraints, r);
}

StepReport ImplicitStage::solve(const State& start, double a, const Matrix3Xd& y, const Matrix3Xd& w,
                                Matrix3Xd& x, Matrix3Xd& v) {
  constexpr double kLoosest = 1e-2, kTightest = 1e-8;  // inner solves
  constexpr double kSufficientDecrease = 1e-4, kRounding = 1e-12;
  constexpr int kMaxNewton = 500, kMaxHalvings = 40;
  const Forces& forces = motion_.forces;

  const bool is_free = motion_.constraints.empty() && !motion_.barrier;
  State trial = start;
  motion_.constrain(trial.v);
  trial.x = y + a * trial.v;
  if (motion_.barrier && motion_.barrier->keep_out(start.x, trial.x)) trial.v = (trial.x - y) / a;
  StepReport report;
  Matrix3Xd r, dx;
  negative_gradient(trial, start.x, a, w, r);
  const double first = r.norm();
  while (true) {
    if (!std::isfinite(r.norm())) {
      report.status = Status::Diverged;
      break;
    }
    if (r.norm() == 0) break;
    if (report.newton_iterations == kMaxNewton) {
      report.status = Status::NotConverged;
      break;
    }
    SolveReport linear;
    // The exact Hessian converges quadratically; where it is indefinite, conjugate gradients notice and stop.
    bool is_exact = false;
    for (Curvature curvature : {Curvature::Exact, Curvature::Projected}) {
      A_.set(trial, start.x, {(1 / a + forces.mass_damping) / a, 1, 1 / a}, curvature);
      dx = Matrix3Xd::Zero(3, r.cols());
      linear = solver_.solve(A_.system(), r, dx, std::clamp(r.norm() / first, kTightest, kLoosest));
      report.linear_iterations += linear.iterations;
      is_exact = curvature == Curvature::Exact;
      if (linear.is_converged) break;
    }
    report.residual = linear.residual;
    ++report.newton_iterations;

    const State before = trial;
    const double value = objective(before, start.x, a, w), slope = -r.cwiseProduct(dx).sum(), norm = r.norm();
    const SmallRotation turn = is_free ? best_rotation(dx, before.x, motion_.model.mass) : SmallRotation{};
    const auto move = [&](double step) {
      trial.x = before.x + step * dx;
      if (is_free) bend(turn, step, before.x, trial.x);
      trial.v = before.v + (trial.x - before.x) / a;
      return objective(trial, start.x, a, w);
    };
    const auto has_smaller_gradient = [&] {
      negative_gradient(trial, start.x, a, w, r);
      return r.norm() < norm;
    };
    // Near the minimum the sum is flat to the rounding of its terms; there its gradient decides.
    const bool is_flat = -slope < kRounding * (std::abs(value) + energy_scale_);
    bool is_accepted = false;
    double step = motion_.barrier ? motion_.barrier->largest_step(before.x, dx) : 1, moved = 0;
    for (int halving = 0; halving < kMaxHalvings; ++halving, step /= 2) {
      moved = move(step);
      is_accepted =
          moved <= value + kSufficientDecrease * step * slope || (is_flat && has_smaller_gradient());
      if (is_accepted) break;
    }
    if (is_accepted && step == 1 && !is_exact && !is_flat &&
        !motion_.barrier) {  // stiffer than a body that buckles
      for (double further = move(2); further < moved; further = move(2 * step)) {
        step *= 2;
        moved = further;
      }
      move(step);
    }
    negative_gradient(trial, start.x, a, w, r);
    const bool is_last = dx.colwise().norm().maxCoeff() <= kStepTolerance * size_;
    if (!is_accepted) {
      trial = before;
      if (!is_last) report.status = Status::NotConverged;
      break;
    }
    if (is_last) break;
    if (motion_.barrier) motion_.barrier->follow(before.x, trial.x);
  }
  x = trial.x;
  v = trial.v;
  return report;
}

}  // namespace testbed::massspring
