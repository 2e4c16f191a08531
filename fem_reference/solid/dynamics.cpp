#include "fem_reference/solid/dynamics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include "fem_reference/base/processes.h"
#include "fem_reference/solid/free_unknowns.h"
#include "meshing/algebra/newton.h"
#include "meshing/scene/scene.h"

namespace testbed::fem {

using Eigen::Matrix3Xd;
using Eigen::VectorXd;

namespace {

using meshing::SparseCholesky;
using meshing::SurfaceMemories;
using Sparse = Eigen::SparseMatrix<double>;

/// Field of unknowns; the last column is filled up with zeros.
Matrix3Xd field_of(const VectorXd& r) {
  Matrix3Xd field = Matrix3Xd::Zero(3, (r.size() + 2) / 3);
  field.reshaped().head(r.size()) = r;
  return field;
}

constexpr double kLinear = 1e-13;  // tolerance of linear forces

}  // namespace

Dynamics dynamics_of(const ElasticSolid& solid, MassMatrix mass) {
  Dynamics system;
  system.K = solid.stiffness(&system.roots);
  system.M = solid.mass(mass);
  if (solid.share().is_whole) return system;
  system.exchange = [&solid](VectorXd& u) {
    Matrix3Xd field = u.reshaped(3, u.size() / 3);
    solid.share().exchange.update(field);
    u = field.reshaped();
  };
  system.step_solver = [&solid](const Sparse& M, double of_mass, const VectorXd& u, double stiffness,
                                const std::vector<int>& constrained) {
    return solid.step_solver(M, of_mass, u.reshaped(3, u.size() / 3), stiffness, constrained);
  };
  return system;
}

GeneralisedAlpha::GeneralisedAlpha(Dynamics system, double h, const TimeScheme& scheme)
    : Integrator(std::move(system), h), scheme_(scheme) {
  // Forces of so small a strain leave rounding alone out of balance, as in a body that rests free of stress.
  constexpr double kLeastStrain = 1e-6;
  const auto n = system_.K.rows();
  if (system_.linearise) {
    const VectorXd f = system_.K * system_.X.reshaped();
    energy_scale_ = sum_over_processes(system_.X.reshaped().dot(f));
    least_size_ = kLeastStrain * norm(f);
  }
  find_free();
  restart(VectorXd::Zero(n), VectorXd::Zero(n));
}

std::string GeneralisedAlpha::solver() const {
  const bool is_newmark = scheme_.alpha_m == 0 && scheme_.alpha_f == 0;
  return std::string(scheme_.gamma == 1 ? "implicit Euler"
                     : is_newmark       ? "Newmark (average acceleration)"
                                        : "generalised-alpha") +
         (system_.linearise ? ", Newton" : "") +
         (system_.step_solver ? ", CG, " + std::to_string(processes().n) + " processes" : ", Cholesky");
}

std::unique_ptr<Integrator> make_generalised_alpha(Dynamics system, double h,
                                                   const ReferenceOptions& options) {
  const auto& radius = options.spectral_radius;
  return std::make_unique<GeneralisedAlpha>(std::move(system), h,
                                            radius ? generalised_alpha(*radius) : kNewmark);
}

std::unique_ptr<Integrator> make_minimising_euler(Dynamics system, double h, const ReferenceOptions&) {
  return std::make_unique<GeneralisedAlpha>(std::move(system), h, kImplicitEuler);
}

void GeneralisedAlpha::find_free() {
  free_ = all_but(system_.constrained, system_.K.rows());
  factor_.reset();
  roots_.resize(0, 0);  // of another tangent
  if (!(system_.step_solver ? factorise_at(VectorXd::Zero(system_.K.rows())) : factorise(system_.K)))
    refuse_indefinite();
}

Linearisation Integrator::respond(const VectorXd& u, bool with_tangent) const {
  if (system_.linearise) return system_.linearise(u, with_tangent);
  const VectorXd force = system_.K * u;
  return {force, {}, {}, u.dot(force) / 2};
}

double Integrator::potential_of(const VectorXd& u) const {
  return sum_over_processes(system_.potential ? system_.potential(u) : respond(u, false).energy);
}

void Integrator::begin_step() {
  if (system_.surface.empty()) return;
  for (const auto& energy : system_.surface) energy->begin_step(t(), h_, at(u_));
  ledger_.begin_step(system_.surface, at(u_));
}

double Integrator::kinetic_energy() const {
  return sum_over_processes(v_.dot(system_.M * v_) / 2);
}

double Integrator::elastic_energy() const {
  return sum_over_processes(respond(u_, false).energy);
}

void Integrator::begin_ledger() {
  constexpr double kRounding = 1e-12;  // of the energy at a strain of one; linear forces have none
  const double scale = system_.linearise && system_.X.size() > 0
                           ? sum_over_processes(system_.X.reshaped().dot(system_.K * system_.X.reshaped()))
                           : 0;
  ledger_.begin(kinetic_energy(), elastic_energy(), system_.surface,
                system_.surface.empty() ? Matrix3Xd() : at(u_), kRounding * scale);
}

void Integrator::change_rest(const std::function<void()>& change) {
  const double before = elastic_energy();
  change();
  ledger_.flows.rest += elastic_energy() - before;
}

/// That damping takes here (W).
double Integrator::damping_power(const VectorXd& v) const {
  double power = 0;
  if (system_.damping > 0) power += system_.damping * v.dot(system_.M * v);
  if (system_.stiffness_damping > 0) power += system_.stiffness_damping * v.dot(system_.K * v);
  return power;
}

/// In the step from displacements u and velocities v, here (J): what supports add to momenta at the mean of velocities,
/// and what they hold against forces along the way.
double Integrator::work_of_supports(const VectorXd& u, const VectorXd& v) const {
  if (!system_.constrained_motion) return 0;
  const VectorXd mean = (v + v_) / 2, p = system_.M * (v_ - v);
  VectorXd f = (force_of(u) + force_of(u_)) / 2 - system_.load + system_.damping * (system_.M * mean);
  if (system_.stiffness_damping > 0) f += system_.stiffness_damping * (system_.K * mean);
  double work = 0;
  for (const int k : system_.constrained) work += p(k) * mean(k) + f(k) * (u_(k) - u(k));
  return work;
}

bool Integrator::advance() {
  const VectorXd u = u_, v = v_;
  const double before = damping_power(v);
  if (!step()) return false;
  meshing::EnergyFlows& flows = ledger_.flows;
  VectorXd here = Eigen::Vector3d(system_.load.dot(u_ - u), h_ / 2 * (before + damping_power(v_)),
                                  work_of_supports(u, v));
  sum_over_processes(here);
  flows.loads += here(0);
  flows.damping += here(1);
  flows.supports += here(2);
  if (!system_.surface.empty()) ledger_.end_step(system_.surface, at(u_));
  return true;
}

VectorXd Integrator::force_of(const VectorXd& u) const {
  if (!system_.forces) return respond(u, false).force;
  Matrix3Xd force;
  system_.forces(u, force);
  return force.reshaped();
}

Integrator::ConstrainedState Integrator::constrained_at(double t) const {
  if (!system_.constrained_motion) {
    const VectorXd zero = VectorXd::Zero(static_cast<Eigen::Index>(system_.constrained.size()));
    return {u_(system_.constrained), zero, zero};
  }
  const VectorXd before = system_.constrained_motion(t - h_), now = system_.constrained_motion(t),
                 after = system_.constrained_motion(t + h_);
  return {now, (after - before) / (2 * h_), (after - 2 * now + before) / (h_ * h_)};
}

/// What mass and tangent count in the step's system for its acceleration.
std::pair<double, double> GeneralisedAlpha::weights() const {
  const auto& [alpha_m, alpha_f, beta, gamma, early] = scheme_;
  const double of_velocity = (1 - alpha_f) * gamma * h_;
  return {(1 - alpha_m) + of_velocity * system_.damping,
          (1 - alpha_f) * beta * h_ * h_ + of_velocity * system_.stiffness_damping};
}

bool GeneralisedAlpha::factorise(const Sparse& tangent) {
  const auto [mass, stiffness] = weights();
  const Sparse A = mass * system_.M + stiffness * tangent;
  ++counts_.factorisations;
  const Sparse lower = restricted(A, free_);
  if (factor_)
    factor_->update(lower);
  else
    factor_.emplace(lower);
  if (!factor_->is_ok()) return false;
  if (system_.linearise) single_ = factor_->single_precision();
  return true;
}

void Integrator::hold(const std::vector<int>& constrained, std::function<VectorXd(double t)> motion) {
  system_.constrained = constrained;
  system_.constrained_motion = std::move(motion);
  find_free();
  const VectorXd u = u_, v = v_;
  go_on(u, v);
}

void Integrator::take_over(const Integrator& before) {
  counts_ = before.counts_;
  begun_ = before.t();
  if (begun_ > 0)  // obstacles come to where they are, and friction is that of the way there
    for (const auto& energy : system_.surface)
      energy->begin_step(begun_ - h_, h_, at(before.u_ - h_ * before.v_));
  remember(memories_of(before.system_.surface), system_.surface);
  restart(before.u_, before.v_);
}

void Integrator::set_state(const MotionState& state) {
  n_steps_ = state.n_steps;
  begun_ = state.begun;
  u_ = state.u;
  v_ = state.v;
  a_ = state.a;
  f_ = state.force;
  remember(state.surface, system_.surface);
  ledger_ = state.ledger;
  find_free();
}

Integrator::ConstrainedState Integrator::start_at(const VectorXd& u, const VectorXd& v) {
  u_ = u;
  v_ = v;
  ConstrainedState constrained = constrained_at(t());
  u_(system_.constrained) = constrained.u;
  v_(system_.constrained) = constrained.v;
  return constrained;
}

void GeneralisedAlpha::go_on(const VectorXd& u, const VectorXd& v) {
  const ConstrainedState constrained = start_at(u, v);
  a_ = VectorXd::Zero(u.size());
  a_(system_.constrained) = constrained.a;
  f_ = force_of(u_);
  const VectorXd others = f_ + system_.stiffness_damping * (system_.K * v_);
  const auto out_of_balance = [&]() -> Balance {
    const VectorXd inertia = system_.M * (a_ + system_.damping * v_).eval();
    return {system_.load - inertia - others, norm(system_.load) + norm(inertia) + norm(others)};
  };
  if (system_.step_solver) {
    const StepSolver solver =
        system_.step_solver(system_.M, 1, VectorXd::Zero(u.size()), 0, system_.constrained);
    const auto add = [&](const VectorXd& a) {
      a_ += a;
      system_.exchange(a_);
    };
    if (!refine(solver, system_.constrained, kLinear, out_of_balance, add)) refuse_indefinite();
    return;
  }
  const SparseCholesky mass(restricted(system_.M, free_));
  if (!mass.is_ok()) refuse_indefinite();
  a_(free_) = mass.solve(out_of_balance().left(free_)).eval();
}

/// An acceleration at the end of a step, and what follows from it.
struct GeneralisedAlpha::Trial {
  VectorXd a, u, v, velocity, f;
};

/// (A + G G^T)^-1 r of the step's system on what is free [Woodbury 1950], by the factor in single precision. Of several
/// processes none where A is not definite.
std::optional<Matrix3Xd> GeneralisedAlpha::direction(const Matrix3Xd& r) const {
  constexpr double kForcing = 1e-2;
  if (solver_) {
    std::optional<VectorXd> x = solver_(r.reshaped(), kForcing);
    if (!x) return {};
    system_.exchange(*x);
    return Matrix3Xd(x->reshaped(3, r.cols()));
  }
  const VectorXd free = r.reshaped()(free_);
  VectorXd x = single_.solve(field_of(free)).reshaped().head(free.size());
  if (roots_.cols() > 0) {
    const Eigen::MatrixXd capacity =
        Eigen::MatrixXd::Identity(roots_.cols(), roots_.cols()) + roots_.transpose() * solved_roots_;
    x -= solved_roots_ * capacity.ldlt().solve(roots_.transpose() * x);
  }
  Matrix3Xd dx = Matrix3Xd::Zero(3, r.cols());
  dx.reshaped()(free_) = x;
  return dx;
}

/// Whether the tangent at u is definite, as far as a factor tells; else that at rest takes its place.
bool GeneralisedAlpha::factorise_at(const VectorXd& u) {
  if (system_.step_solver) {
    const auto [mass, stiffness] = weights();
    ++counts_.factorisations;
    solver_ = system_.step_solver(system_.M, mass, u, stiffness, system_.constrained);
    return true;
  }
  const Linearisation at = respond(u, true);
  const bool is_definite = factorise(at.tangent);
  if (!is_definite && !factorise(system_.K)) refuse_indefinite();
  const auto n_roots = static_cast<Eigen::Index>(at.roots.size()),
             n = static_cast<Eigen::Index>(free_.size());
  roots_.resize(n, n_roots);
  solved_roots_.resize(n, n_roots);
  for (Eigen::Index k = 0; k < n_roots; ++k) {
    roots_.col(k) = std::sqrt((1 - scheme_.alpha_f) * scheme_.beta) * h_ * at.roots[k](free_);
    solved_roots_.col(k) = single_.solve(field_of(roots_.col(k))).reshaped().head(n);
  }
  return is_definite;
}

bool GeneralisedAlpha::step() {
  constexpr int kMaxHalvings = 6;
  const MotionState before = state();
  const int n_halved = counts_.halved;
  const bool is_found = advance_or_halves(kMaxHalvings);
  if (!is_found) set_state(before);
  n_steps_ += is_found;
  counts_.halved = n_halved + (counts_.halved > n_halved);
  return is_found;
}

/// By h_, or twice by half of it. Leaves a state in between where it finds none at the end.
bool GeneralisedAlpha::advance_or_halves(int n_halvings) {
  const SurfaceMemories memories = memories_of(system_.surface);
  const meshing::EnergyLedger ledger = ledger_;
  if (advance_whole()) return true;
  if (!system_.linearise || n_halvings == 0) return false;
  remember(memories, system_.surface);
  ledger_ = ledger;
  ++counts_.halved;
  const double whole = h_, begun = begun_;
  set_length(whole / 2);
  bool is_found = advance_or_halves(n_halvings - 1);
  if (is_found) {
    if (!system_.surface.empty()) ledger_.end_step(system_.surface, at(u_));
    begun_ += whole / 2;
    is_found = advance_or_halves(n_halvings - 1);
  }
  begun_ = begun;
  set_length(whole);
  return is_found;
}

void GeneralisedAlpha::set_length(double h) {
  h_ = h;
  find_free();
}

bool GeneralisedAlpha::advance_whole() {
  begin_step();
  const ConstrainedState constrained = constrained_at(t() + h_);
  Trial trial;
  trial.a = a_;
  trial.a(system_.constrained) = constrained.a;
  const bool is_linear = !system_.linearise;
  if (!(is_linear ? find_linear_acceleration(constrained, trial) : find_acceleration(constrained, trial)))
    return false;
  u_.swap(trial.u);
  v_.swap(trial.v);
  a_.swap(trial.a);
  if (!is_linear) f_.swap(trial.f);
  return true;
}

/// From the acceleration of the step before on. Whether iterations got there.
bool GeneralisedAlpha::find_linear_acceleration(const ConstrainedState& constrained, Trial& trial) const {
  const double alpha_f = scheme_.alpha_f;
  follow(constrained, trial);
  const auto out_of_balance = [&]() -> Balance {
    const VectorXd inertia = momentum_change(trial);
    const VectorXd f =
        force_of((1 - alpha_f) * trial.u + alpha_f * u_ + system_.stiffness_damping * trial.velocity);
    return {system_.load - inertia - f, norm(system_.load) + norm(inertia) + norm(f)};
  };
  const auto add = [&](const VectorXd& a) {
    trial.a += a;
    follow(constrained, trial);
  };
  if (solver_) return refine(solver_, system_.constrained, kLinear, out_of_balance, add);
  VectorXd a = VectorXd::Zero(trial.a.size());
  a(free_) = factor_->solve(out_of_balance().left(free_));
  add(a);
  return true;
}

/// Displacement and velocity that an acceleration leads to.
void GeneralisedAlpha::follow(const ConstrainedState& constrained, Trial& trial) const {
  const auto& [alpha_m, alpha_f, beta, gamma, early] = scheme_;
  if (system_.exchange) system_.exchange(trial.a);
  trial.u = u_ + h_ * v_ + h_ * h_ * (early * a_ + beta * trial.a);
  trial.v = v_ + h_ * ((1 - gamma) * a_ + gamma * trial.a);
  trial.u(system_.constrained) = constrained.u;
  trial.v(system_.constrained) = constrained.v;
  trial.velocity = (1 - alpha_f) * trial.v + alpha_f * v_;
}

/// Forces of inertia and of the damping of mass (N).
VectorXd GeneralisedAlpha::momentum_change(const Trial& trial) const {
  const double alpha_m = scheme_.alpha_m;
  return system_.M * ((1 - alpha_m) * trial.a + alpha_m * a_ + system_.damping * trial.velocity).eval();
}

/// Whose negative gradient by the displacement of free unknowns is the force out of balance (J); of all processes.
double GeneralisedAlpha::incremental_potential(const Trial& trial) const {
  const auto& [alpha_m, alpha_f, beta, gamma, early] = scheme_;
  const VectorXd a = (1 - alpha_m) * trial.a + alpha_m * a_, way = trial.u - u_;
  double sum =
      beta * h_ * h_ / (2 * (1 - alpha_m)) * a.dot(system_.M * a) + way.dot(alpha_f * f_ - system_.load);
  if (system_.damping > 0)
    sum += system_.damping * beta * h_ / (2 * gamma * (1 - alpha_f)) *
           trial.velocity.dot(system_.M * trial.velocity);
  return sum_over_processes(sum) + (1 - alpha_f) * potential_of(trial.u);
}

/// At finite strain, from the acceleration of the step before on. Whether there is one.
bool GeneralisedAlpha::find_acceleration(const ConstrainedState& constrained, Trial& trial) {
  const double alpha_f = scheme_.alpha_f, by_acceleration = scheme_.beta * h_ * h_;  // of displacement
  constexpr double kRounding = 1e-6, kSlow = 0.3, kLastStep = 1e-9;
  constexpr int kMaxIterations = 50, kMaxIterationsOfContact = 200, kMaxHalvings = 50;
  // Free unknowns that stay where they are strain the body no more than it is.
  VectorXd still = -(v_ / h_ + scheme_.early * a_) / scheme_.beta;
  still(system_.constrained) = constrained.a;
  follow(constrained, trial);
  const meshing::SurfaceEnergies& surface = system_.surface;
  if (!surface.empty()) {
    Matrix3Xd guess = at(trial.u);
    bool is_moved = false;
    for (const auto& energy : surface) is_moved |= energy->keep_out(at(u_), guess);
    if (is_moved) {
      trial.a(free_) += (guess - at(trial.u)).reshaped()(free_) / by_acceleration;
      follow(constrained, trial);
    }
  }
  for (int n = 0; !std::isfinite(potential_of(trial.u)); ++n) {
    if (n == kMaxHalvings) return false;
    trial.a = ((trial.a + still) / 2).eval();
    follow(constrained, trial);
  }
  if (passes_through(surface, at(u_), at(trial.u))) return false;

  Trial start = trial;
  double size = 0, error = 0, before = std::numeric_limits<double>::infinity();
  bool is_new = false;
  meshing::Objective objective;
  objective.dot = [](const Matrix3Xd& a, const Matrix3Xd& b) {
    return sum_over_processes(a.cwiseProduct(b).sum());
  };
  objective.longest = [](const Matrix3Xd& a) {
    return largest_over_processes(a.colwise().norm().maxCoeff());
  };
  objective.value = [&] { return incremental_potential(trial); };
  objective.negative_gradient = [&](Matrix3Xd& r) {
    trial.f = force_of(trial.u);
    const VectorXd inertia = momentum_change(trial);
    size = norm(system_.load) + norm(inertia) + norm(trial.f);
    VectorXd residual = system_.load - inertia - (1 - alpha_f) * trial.f - alpha_f * f_;
    residual(system_.constrained).setZero();
    r = field_of(residual);
  };
  objective.is_end = [&](const Matrix3Xd& r, meshing::NewtonReport&) {
    error = norm(r.reshaped()) / std::max(size, least_size_);
    return error <= system_.tolerance || (is_new && error > kSlow * before && error <= kRounding);
  };
  objective.direction = [&](const Matrix3Xd& r, Matrix3Xd& dx) {
    is_new = error > kSlow * before;
    if (is_new) is_new = factorise_at(trial.u);
    before = error;
    std::optional<Matrix3Xd> found = direction(r);
    if (!found) {
      is_new = false;
      factorise_at(VectorXd::Zero(trial.u.size()));
      found = direction(r);
    }
    if (!found) refuse_indefinite();
    dx = by_acceleration * *found;
    return false;
  };
  objective.largest_step = [&](const Matrix3Xd& dx) {
    double part = 1;
    for (const auto& energy : surface) part = std::min(part, energy->largest_step(at(start.u), dx));
    return part;
  };
  objective.move = [&](const Matrix3Xd& dx, double step) {
    trial.a = start.a + step / by_acceleration * dx.reshaped().head(trial.a.size());
    follow(constrained, trial);
  };
  objective.accept = [&] {
    for (const auto& energy : surface) energy->follow(at(start.u), at(trial.u));
    start = trial;
  };
  const bool is_stiff = meshing::is_stiff(surface);
  const meshing::NewtonOptions options{is_stiff ? kMaxIterationsOfContact : kMaxIterations, energy_scale_,
                                       is_stiff ? kLastStep * diagonal_over_processes(system_.X) : 0};
  bool is_ok = false;
  const auto minimise = [&] {
    before = std::numeric_limits<double>::infinity();
    is_new = false;
    meshing::NewtonReport newton = meshing::minimise(objective, options);
    is_ok = newton.status == meshing::Status::Ok;
    if (newton.status == meshing::Status::NotConverged && error <= kRounding)
      newton.status = meshing::Status::Ok;
    return newton;
  };
  const meshing::NewtonReport newton = minimise_constrained(surface, minimise, [&] { return at(trial.u); });
  counts_.newton_iterations += newton.iterations;
  if (!is_ok || is_stiff) trial.f = force_of(trial.u);  // which was last asked for elsewhere
  return newton.status == meshing::Status::Ok;
}

}  // namespace testbed::fem
