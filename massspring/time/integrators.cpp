#include "massspring/time/integrators.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/largest_eigenvalue.h"
#include "meshing/base/random.h"

namespace testbed::massspring {
using Eigen::Matrix3Xd;

TimeStepper::TimeStepper(const MassSpringModel& model, const Forces& forces, const std::string& integrator,
                         double end, const IntegratorOptions& options, const Contacts& contacts)
    : motion_(model, forces, contacts),
      integrator_(find_integrator(integrator)),
      options_(options),
      end_(end),
      supports_(motion_.constraints),
      is_driven_(std::any_of(supports_.begin(), supports_.end(),
                             [](const Constraint& c) {
                               return !c.displacement.isZero(0) || c.motion[0] || c.motion[1] || c.motion[2];
                             })),
      size_((model.network.X.rowwise().maxCoeff() - model.network.X.rowwise().minCoeff()).norm()),
      rest_norm_(model.network.X.norm()),
      scheme_(integrator_.make(motion_, options)) {
  if (size_ == 0)
    throw std::runtime_error("all nodes lie in one point, expected a body: its size tells far from near");
  check_contacts(integrator_, options.tolerance, !contacts.bodies.empty(),
                 contacts.self_thickness.has_value());
  if (model.consistent_mass && integrator_.is_explicit)
    throw std::runtime_error(
        "an explicit scheme, expected mass at nodes: consistent mass has no simple inverse");
  if (integrator_.has_barriers()) motion_.add_barriers();
  if (!contacts.bodies.empty() && integrator_.in_touch) in_touch_ = integrator_.in_touch(motion_, options);
  if (!contacts.bodies.empty() && integrator_.is_linearised) motion_.add_friction();
}

StepReport TimeStepper::step(State& state, double h) {
  if (options_.sleep_below > 0 && stays_at_rest(state, h)) {
    state.v.setZero();
    state.t += h;
    StepReport report;
    report.is_at_rest = true;
    return report;
  }
  constexpr int kMaxHalvings = 6;
  return options_.tolerance > 0 ? step_in_parts(state, h) : step_or_halves(state, h, kMaxHalvings);
}

/// Slow, and no force would make any node fast within a second. Damping does not count: it holds back only
/// what moves.
bool TimeStepper::stays_at_rest(const State& state, double h) {
  constexpr double kWhile = 1;  // s
  const double slow = options_.sleep_below;
  if (state.v.colwise().norm().maxCoeff() >= slow) return false;
  for (const Constraint& c : supports_)
    if (prescribed(c, state.t, end_) != prescribed(c, state.t + h, end_)) return false;
  for (const RigidBody& body : motion_.contacts.bodies)
    if (body.translation(state.t) != body.translation(state.t + h)) return false;
  // What begins a step anew at its end forgets the friction that held in it.
  remember(state.history.surface, motion_.surface());
  if (const StepHistory& last = state.history; last.x.cols() > 0)
    for (const auto& energy : motion_.surface()) energy->begin_step(last.t, last.h, last.x);
  constrain_touching(state, h);
  Matrix3Xd f;
  motion_.undamped_forces_at(state, f);
  filter(motion_.constraints, f);
  return (f.colwise().norm().transpose().array() * kWhile < slow * motion_.model.mass.array()).all();
}

/// Nodes that the linearised scheme constrains to obstacles.
void TimeStepper::constrain_touching(const State& state, double h) {
  if (!motion_.friction) return;
  motion_.constraints = supports_;
  constrain_active(motion_.contacts.bodies, state, h, motion_.constraints, *motion_.friction);
}

StepReport TimeStepper::step_or_halves(State& state, double h, int n_halvings) {
  if (!integrator_.minimises() || n_halvings == 0) return step_whole(state, h);
  const State before = state;
  StepReport report = step_whole(state, h);
  if (report.status != Status::NotConverged) return report;
  state = before;
  report.status = Status::Ok;
  report.is_halved = true;
  for (int half = 0; half < 2 && report.status != Status::Diverged; ++half) {
    // Where the shortest part found none, what is left of the step is not cut further.
    const StepReport part = step_or_halves(state, h / 2, report.status == Status::Ok ? n_halvings - 1 : 0);
    report.status = std::max(report.status, part.status);
    report.newton_iterations += part.newton_iterations;
    report.linear_iterations += part.linear_iterations;
    report.residual = part.residual;
  }
  if (report.status == Status::Diverged)
    state = before;
  else
    state.t = before.t + h;
  return report;
}

StepReport TimeStepper::step_in_parts(State& state, double h) {
  constexpr double kSafety = 0.9, kShrink = 0.2, kGrow = 2;
  constexpr double kShortest = 1e-9;  // of the step
  const double end = state.t + h, order = integrator_.order;
  StepReport total;
  double next = state.history.part == 0 ? h : state.history.part;
  while (end - state.t > kShortest * h) {
    const double part = std::min(next, end - state.t);
    State whole = state, halves = state;
    Status status = Status::Ok;
    for (const auto& [end_state, length] :
         {std::pair(&whole, part), std::pair(&halves, part / 2), std::pair(&halves, part / 2)}) {
      const StepReport report = step_whole(*end_state, length);
      status = std::max(status, report.status);
      total.newton_iterations += report.newton_iterations;
      total.linear_iterations += report.linear_iterations;
      total.residual = report.residual;
      if (status != Status::Ok) break;
    }
    const double error = status == Status::Ok ? (whole.x - halves.x).colwise().norm().maxCoeff() /
                                                    (std::pow(2, order) - 1) / size_
                                              : std::numeric_limits<double>::infinity();
    const double factor =
        std::clamp(kSafety * std::pow(options_.tolerance / error, 1 / (order + 1)), kShrink, kGrow);
    const bool is_accepted = error <= options_.tolerance;
    if (is_accepted) state = halves;
    if (!is_accepted || part == next)
      next = factor * part;  // one cut by the end does not tell what more does
    state.history.part = next;
    if (next < kShortest * h) {
      total.status = std::max(status, Status::NotConverged);
      return total;
    }
  }
  state.t = end;
  return total;
}

StepReport TimeStepper::step_whole(State& state, double h) {
  state.u.resize(3, 0);  // of a state that statics left
  state.loading.reset();
  const std::vector<RigidBody>& bodies = motion_.contacts.bodies;
  const SurfaceEnergies surface = motion_.surface();
  remember(state.history.surface, surface);
  for (const auto& energy : surface) energy->begin_step(state.t, h, state.x);
  for (size_t i = 0; i < supports_.size(); ++i) {
    Constraint& c = supports_[i];
    c.velocity = (prescribed(c, state.t + h, end_) - prescribed(c, state.t, end_)) / h;
    motion_.constraints[i].velocity = c.velocity;
  }
  constrain_touching(state, h);
  meshing::EnergyLedger ledger = state.ledger;
  ledger.begin_step(surface_at(state), state.x);
  if (motion_.friction || is_driven_) v_before_ = state.v;
  motion_.constrain(state.v);
  StepReport report = scheme_->advance(state, h, x_, v_);
  StepHistory history;
  history.part = state.history.part;
  if (motion_.friction) {
    State after = state;
    after.x = x_;
    after.v = v_;
    Matrix3Xd f;
    motion_.forces_at(after, f);
    f = momenta(motion_.model, (v_ - v_before_) / h) - f;
    history.active_set = settle_active(bodies, state, h, motion_.model.mass, f, x_, v_, ledger.flows);
    const bool has_moved = std::any_of(bodies.begin(), bodies.end(), [&](const RigidBody& body) {
      return body.translation(state.t + h) != body.translation(state.t);
    });
    if (has_moved && after.x != x_) {  // pushed to where bodies have gone, which strains the solid
      const double before = elastic_energy(motion_.model, after);
      after.x = x_;
      ledger.flows.obstacles += elastic_energy(motion_.model, after) - before;
    }
  } else if (integrator_.is_explicit) {
    const meshing::EnergyFlows flows = ledger.flows;
    history.clearance = state.history.clearance;
    if (push_out(bodies, state, h, motion_.model.mass, history.clearance, x_, v_, ledger.flows) &&
        in_touch_) {
      ledger.flows = flows;
      history.clearance = state.history.clearance;
      step_in_touch(state, h, history.clearance, ledger.flows);
    }
  }
  prescribe(supports_, motion_.model.network.X, state.t + h, end_, x_);
  constexpr double kFarOff = 1e6;
  if (!(x_.norm() < rest_norm_ + kFarOff * size_) || !std::isfinite(v_.squaredNorm()))
    report.status = Status::Diverged;
  if (report.status == Status::Diverged) return report;
  if (integrator_.has_memory || (options_.sleep_below > 0 && !surface.empty())) {
    history.t = state.t;
    history.h = h;
    history.x = state.x;
    history.v = state.v;
  }
  ledger.end_step(surface, x_);
  ledger.flows.loads += motion_.forces.load.cwiseProduct(x_ - state.x).sum();
  ledger.flows.damping += h / 2 * (damping_power_at(state.x, state.v) + damping_power_at(x_, v_));
  if (is_driven_) ledger.flows.supports += work_of_supports(state, h);
  state.ledger = std::move(ledger);
  history.surface = memories_of(surface);
  state.history = std::move(history);
  state.x.swap(x_);
  state.v.swap(v_);
  state.t += h;
  return report;
}

/// In parts as short as the scheme's stages: those of lower order have a shorter stable step.
void TimeStepper::step_in_touch(const State& state, double h, std::vector<Eigen::VectorXd>& clearance,
                                meshing::EnergyFlows& flows) {
  constexpr int kParts = 4;
  State part = state;
  for (int n = 0; n < kParts; ++n) {
    in_touch_->advance(part, h / kParts, x_, v_);
    push_out(motion_.contacts.bodies, part, h / kParts, motion_.model.mass, clearance, x_, v_, flows);
    part.x = x_;
    part.v = v_;
    part.t += h / kParts;
  }
}

SurfaceEnergies TimeStepper::surface_at(const State& state) const {
  massspring::surface_at(motion_.forces, state);
  return motion_.surface();
}

/// That damping takes (W).
double TimeStepper::damping_power_at(const Matrix3Xd& x, const Matrix3Xd& v) const {
  const MassSpringModel& model = motion_.model;
  const double c = motion_.forces.mass_damping;
  double power = c > 0 ? 2 * c * kinetic_energy(model, v) : 0;
  if (model.springs && model.springs->damping > 0)
    power += damping_power(*model.springs, motion_.damped_at(x), v);
  return power;
}

/// In the step from `state` to x_ and v_ (J): what supports add to momenta at the mean of velocities, and what
/// they hold against forces along the way.
double TimeStepper::work_of_supports(const State& state, double h) const {
  State after = state;
  after.x = x_;
  after.v = v_;
  after.t = state.t + h;
  Matrix3Xd f0, f1;
  motion_.forces_at(state, f0);
  motion_.forces_at(after, f1);
  const Matrix3Xd p = momenta(motion_.model, v_ - v_before_);
  double work = 0;
  for (const Constraint& c : supports_) {
    const int i = c.node;
    const Eigen::Vector3d v = (v_before_.col(i) + v_.col(i)) / 2, way = x_.col(i) - state.x.col(i);
    work += (v - c.S * v).dot(p.col(i)) - (way - c.S * way).dot(f0.col(i) + f1.col(i)) / 2;
  }
  return work;
}

double stable_step(const MassSpringModel& model, const Forces& forces, const State& state) {
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, state, K);
  const SurfaceHessian surface = surface_hessian(forces, state, Curvature::Projected);
  const Eigen::VectorXd scale = model.mass.cwiseSqrt().cwiseInverse();
  Matrix3Xd scaled, Kq;
  const auto product = [&](const Matrix3Xd& q) -> Matrix3Xd {  // M^-1/2 K M^-1/2 q
    scaled = q * scale.asDiagonal();
    multiply(K, scaled, Kq);
    surface.add_product(scaled, Kq);
    filter(forces.constraints, Kq);
    return Kq * scale.asDiagonal();
  };

  Random random(1);
  Matrix3Xd q(3, state.x.cols());
  for (double& c : q.reshaped()) c = random.uniform() - 0.5;
  filter(forces.constraints, q);
  const double largest = largest_eigenvalue(product, q);
  const double c = forces.mass_damping;
  return 4 / (c + std::sqrt(c * c + 4 * largest));
}

}  // namespace testbed::massspring
