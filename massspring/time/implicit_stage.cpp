#include "massspring/time/implicit_stage.h"

#include <Eigen/Geometry>
#include <algorithm>

#include "meshing/algebra/newton.h"
#include "meshing/algebra/rigid_motion.h"
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

ImplicitStage::ImplicitStage(EquationOfMotion& motion, bool keeps_step, double residual)
    : motion_(motion),
      A_(motion),
      kept_(motion, keeps_step),
      residual_(residual),
      load_size_(motion.forces.load.norm()),
      size_(
          (motion.model.network.X.rowwise().maxCoeff() - motion.model.network.X.rowwise().minCoeff()).norm()),
      energy_scale_(motion.model.material.E * volume(motion.model.network.X, motion.model.network.F)) {
  if (is_linear(motion)) constant_.emplace(motion, A_, solver_, keeps_step);
}

std::string ImplicitStage::solver_choice() const {
  if (constant_) return constant_->choice();
  return kept_.is_in_use() ? "Cholesky factor, kept while Newton's method converges fast" : solver_.choice();
}

/// Negative gradient of the sum.
/// @param size  becomes that of what it adds up
Matrix3Xd ImplicitStage::unbalanced(const State& start, const State& trial, double a, const Matrix3Xd& w,
                                    double& size) const {
  Matrix3Xd r;
  motion_.undamped_forces_at(trial, r);
  motion_.add_spring_damping(start.x, trial.v, r);
  const Matrix3Xd inertia = momenta(motion_.model, (trial.v - w) / a + motion_.forces.mass_damping * trial.v);
  size = load_size_ + r.norm() + inertia.norm();
  r -= inertia;
  filter(motion_.constraints, r);
  return r;
}

/// From the guess x = y + a v_0 on, A dx = r with the gradient r there.
StepReport ImplicitStage::solve_linear(const State& start, double a, const Matrix3Xd& y, const Matrix3Xd& w,
                                       Matrix3Xd& x, Matrix3Xd& v) {
  State trial = start;
  motion_.constrain(trial.v);
  trial.x = y + a * trial.v;
  double size = 0;
  const Matrix3Xd r = unbalanced(start, trial, a, w, size);
  Matrix3Xd dx;
  const SolveReport linear = constant_->solve({(1 / a + motion_.forces.mass_damping) / a, 1, 1 / a}, r, dx);
  x = trial.x + dx;
  v = trial.v + dx / a;
  StepReport report;
  report.newton_iterations = 1;
  report.linear_iterations = linear.iterations;
  report.residual = linear.residual;
  if (!linear.is_converged) report.status = x.allFinite() ? Status::NotConverged : Status::Diverged;
  return report;
}

StepReport ImplicitStage::solve(const State& start, double a, const Matrix3Xd& y, const Matrix3Xd& w,
                                Matrix3Xd& x, Matrix3Xd& v) {
  if (constant_) return solve_linear(start, a, y, w, x, v);
  constexpr double kLoosest = 1e-2, kTightest = 1e-8;  // inner solves
  constexpr int kMaxNewton = 500;
  const MassSpringModel& model = motion_.model;
  const double mass_damping = motion_.forces.mass_damping;
  const SurfaceEnergies energies = motion_.surface();
  const auto any = [&](const auto& is) { return std::any_of(energies.begin(), energies.end(), is); };
  const bool is_bounded = any([](const auto& energy) { return energy->bounds_steps(); });  // on straight ways
  const bool is_free = motion_.constraints.empty() && !is_bounded &&
                       !any([](const auto& energy) { return !energy->is_invariant(); });
  State trial = start;
  motion_.constrain(trial.v);
  trial.x = y + a * trial.v;
  StepReport report;
  SmallRotation turn;
  double first = 0, size = 0;  // of gradients, and of what they add up

  Objective objective;
  objective.value = [&] {
    double sum = kinetic_energy(model, trial.v - w) + motion_.potential(trial);
    if (mass_damping > 0) sum += a * mass_damping * kinetic_energy(model, trial.v);
    if (model.springs && model.springs->damping > 0)
      sum += a * damping_power(*model.springs, motion_.damped_at(start.x), trial.v) / 2;
    return sum;
  };
  if (is_bounded) {
    // Pushed out alone, a surface may leave behind what is inside; from where the body was it may be far.
    const auto move_out = [&](const Matrix3Xd& guess) {
      constexpr int kMaxSweeps = 20;  // between what must not be entered and what supports hold
      trial.x = guess;
      for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
        bool is_moved = false;
        for (const auto& energy : energies) is_moved |= energy->keep_out(start.x, trial.x);
        if (!is_moved) return sweep > 0;
        trial.v = (trial.x - y) / a;
        motion_.constrain(trial.v);
        trial.x = y + a * trial.v;
      }
      return true;
    };
    if (move_out(trial.x)) {
      const State pushed = trial;
      const double energy = objective.value();
      trial.v = (start.x - y) / a;
      motion_.constrain(trial.v);
      move_out(y + a * trial.v);
      if (energy <= objective.value()) trial = pushed;
    }
    if (passes_through(energies, start.x, trial.x)) {
      report.status = Status::NotConverged;
      x = start.x;
      v = start.v;
      return report;
    }
  }
  State before = trial;
  objective.negative_gradient = [&](Matrix3Xd& r) { r = unbalanced(start, trial, a, w, size); };
  const bool is_stiff = any([](const auto& energy) { return energy->is_stiff(); });
  if (!is_stiff)
    objective.is_end = [&](const Matrix3Xd& r, NewtonReport&) {
      report.residual = r.norm() / size;
      return report.residual <= residual_;
    };
  const ImplicitMatrix::Factors factors{(1 / a + mass_damping) / a, 1, 1 / a};
  const auto set = [&](Curvature curvature) { A_.set(trial, start.x, factors, curvature); };
  kept_.begin();
  objective.direction = [&](const Matrix3Xd& r, Matrix3Xd& dx) {
    if (first == 0) first = r.norm();
    const double tolerance = std::clamp(r.norm() / first, kTightest, kLoosest);
    SolveReport linear;
    // The exact Hessian converges quadratically; where it is indefinite, conjugate gradients notice and stop.
    bool is_exact = true, is_solved = kept_.solve(r, factors, set, A_, dx);
    for (Curvature curvature : {Curvature::Exact, Curvature::Projected}) {
      if (is_solved) break;
      set(curvature);
      dx = Matrix3Xd::Zero(3, r.cols());
      linear = solver_.solve(A_.system(), r, dx, tolerance);
      report.linear_iterations += linear.iterations;
      is_exact = curvature == Curvature::Exact;
      is_solved = linear.is_converged;
    }
    if (is_stiff) report.residual = linear.residual;
    if (is_free) turn = best_rotation(dx, before.x, model.mass);
    return is_exact;
  };
  if (is_bounded)
    objective.largest_step = [&](const Matrix3Xd& dx) {
      double part = 1;
      for (const auto& energy : energies) part = std::min(part, energy->largest_step(before.x, dx));
      return part;
    };
  objective.move = [&](const Matrix3Xd& dx, double step) {
    trial.x = before.x + step * dx;
    if (is_free) bend(turn, step, before.x, trial.x);
    trial.v = before.v + (trial.x - before.x) / a;
  };
  objective.accept = [&] {
    for (const auto& energy : energies) energy->follow(before.x, trial.x);
    before = trial;
  };
  const NewtonReport newton = minimise_constrained(
      energies,
      [&] {
        return minimise(objective, {kMaxNewton, energy_scale_, kStepTolerance * size_, !is_bounded});
      },
      [&] { return trial.x; });
  report.newton_iterations = newton.iterations;
  report.status = newton.status;
  x = trial.x;
  v = trial.v;
  return report;
}

}  // namespace testbed::massspring
