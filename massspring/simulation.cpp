#include "massspring/simulation.h"

#include <algorithm>
#include <limits>
#include <sstream>
#include <stdexcept>

#include "massspring/calibrations/calibrate.h"
#include "massspring/model/collapse.h"
#include "massspring/statics/frequencies.h"
#include "massspring/time/implicit_stage.h"
#include "meshing/base/geometry.h"
#include "meshing/scene/changed_keys.h"
#include "meshing/scene/initial_motion.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/initial_overlap.h"

namespace testbed::massspring {
namespace {

constexpr int kMostUnsolved = 3;  // steps in a row of a motion

SurfaceMesh surface_of(const SpringNetwork& network) {
  return {network.X.leftCols(network.n_surface), network.F, network.cuts};
}

/// The solid of a scene, with its skin and volumes.
MassSpringModel model_of(const Scene& scene, const SurfaceProblem& problem, const SpringNetwork& network) {
  const Calibration& calibration = find_calibration(scene.network.calibration);
  const double share = scene.network.link_share;
  std::vector<int> constrained;
  for (const auto& [vertices, support] : problem.constrained)
    constrained.insert(constrained.end(), vertices.begin(), vertices.end());
  MassSpringModel model = share > 0
                              ? calibrate_with_links(network, scene.material, calibration, share, constrained)
                              : calibrate(network, scene.material, calibration, constrained);
  const bool is_explicit_run =
      scene.time.mode == TimeMode::Dynamic && find_integrator(scene.time.integrator).is_explicit;
  if (model.tet_springs && scene.network.mass == MassMatrix::Consistent && !is_explicit_run)
    model.consistent_mass = consistent_mass(network.X, network.T, scene.material.rho);
  if (model.springs) {
    if (law_of(scene) != MaterialLaw::SmallStrain) model.springs->law = scene.network.spring_law;
    model.springs->damping = scene.network.spring_damping;
  }
  if (scene.skin) add_skin(*scene.skin, model);
  if (!scene.seams.empty()) model.seams = seams_of(problem);
  if (scene.volume && scene.volume->local > 0) {
    model.local_volume = LocalVolume{scene.volume->local, network.T, Eigen::VectorXd(network.T.cols())};
    for (Eigen::Index t = 0; t < network.T.cols(); ++t)
      model.local_volume->rest_volume(t) = tet_volume(network.X, network.T.col(t));
  }
  return model;
}

/// Ascending nodes whose motion is prescribed.
std::vector<int> driven_nodes(const std::vector<Constraint>& constraints) {
  std::vector<int> driven;
  for (const Constraint& c : constraints)
    if (!c.displacement.isZero(0) || c.motion[0] || c.motion[1] || c.motion[2]) driven.push_back(c.node);
  std::sort(driven.begin(), driven.end());
  return driven;
}

std::ptrdiff_t n_holding_at(const Scene& scene, double t) {
  return std::count_if(scene.supports.begin(), scene.supports.end(),
                       [t](const Support& support) { return holds_at(support, t); });
}

/// Of sums over a body (J). Linear forces have none that a gain could be taken for, but positions have.
double rounding_of_energy(const MassSpringModel& model, const Forces& forces) {
  constexpr double kOfEnergy = 1e-12, kOfPositions = 1e-13;  // the former of the energy at a strain of one
  const Eigen::Matrix3Xd& X = model.network.X;
  return (model.linear ? 0 : kOfEnergy * model.material.E * volume(X, model.network.F)) +
         kOfPositions * forces.load.norm() * X.norm();
}

bool collapses(const Scene& scene) {
  return scene.collapse || std::any_of(scene.events.begin(), scene.events.end(),
                                       [](const Event& event) { return event.after->collapse.has_value(); });
}

void check_events(const Scene& scene) {
  const Scene* before = &scene;
  for (size_t e = 0; e < scene.events.size(); ++e) {
    try {
      meshing::changed_keys(*before, *scene.events[e].after);
    } catch (const std::runtime_error& error) {
      const auto place = scene.places.find("events." + std::to_string(e) + ".key");
      throw std::runtime_error((place == scene.places.end() ? "" : place->second + ": ") + error.what());
    }
    before = scene.events[e].after.get();
  }
}

}  // namespace

Simulation::Simulation(const Scene& scene, const SpringNetwork& network)
    : first_(scene), scene_(scene), network_(network), problem_(discretise(scene, surface_of(network))) {
  check_events(scene);
  make_model();
  act_on_model();
  check_apart(contacts_, model_, forces_.constraints);
  state_ = initial_state(model_);
  push_out_of_obstacles();
  state_.v = initial_velocity(scene, model_.network.X, model_.mass, box_of(model_.network.X));
  filter(forces_.constraints, state_.v);
  begin_stepping();
  count_steps();
}

/// To equilibrium beside obstacles that it may overlap.
void Simulation::push_out_of_obstacles() {
  if (scene_.supports.empty()) {
    state_.x.colwise() += way_beside(contacts_.bodies, model_.network.X, model_.network.F);
    return;
  }
  const auto apart = without_overlap(scene_, contacts_.bodies, model_.network.X, model_.network.F);
  if (!apart) return;
  Simulation statics(*apart, network_);
  while (!statics.has_ended()) statics.advance();
  if (statics.status() != Status::Ok)
    throw std::runtime_error("obstacles.initially = \"resolve\" finds no equilibrium beside obstacles: " +
                             statics.report().reason);
  state_.x = statics.state().x;
}

void Simulation::make_model() {
  model_ = model_of(scene_, problem_, network_);
  if (model_.consistent_mass)
    lump(driven_nodes(constraints_of(problem_, surface_of(model_))), *model_.consistent_mass);
  // A quarter of what large bodies' patches take is for collapses alone.
  if (model_.tet_springs && !collapses(scene_)) model_.tet_springs->weight.resize(0);
  find_collapsing();
  report_.full_geometry.clear();
  if (law_of(scene_) != MaterialLaw::SmallStrain) return;
  // Statics hold floppy motions. In motion, linear forces would let them drift without bound.
  constexpr double kForever = std::numeric_limits<double>::infinity();
  const std::optional<bool> is_floppy =
      scene_.time.mode == TimeMode::Dynamic
          ? has_floppy_motions(model_, constraints_of(problem_, surface_of(model_), kForever))
          : false;
  if (is_floppy == false)
    linearise(model_);
  else
    report_.full_geometry =
        std::string(is_floppy ? "the network has motions that cost no energy, which"
                              : "the network is too large to look for motions that cost no energy, which") +
        " would drift without bound in linear geometry";
}

void Simulation::find_collapsing() {
  model_.collapsing.resize(0);
  if (scene_.collapse && !scene_.collapse->surface && model_.tet_springs)
    model_.collapsing = collapsing_patches(*scene_.collapse, model_);
}

/// Of the body at rest, whatever the state.
void Simulation::act_on_model() {
  forces_ = forces_of(scene_, problem_, model_, state_.t);
  contacts_ = contacts_of(scene_, surface_of(model_));
  const TimeOptions& time = scene_.time;
  if (time.mode == TimeMode::Static) {
    if (!contacts_.bodies.empty()) add_obstacles(contacts_, model_, forces_);
    return;
  }
  if (scene_.material.damping_ratio > 0)
    forces_.mass_damping += damping_of_ratio(model_, forces_, scene_.material.damping_ratio);
  const Integrator& integrator = find_integrator(time.integrator);
  constexpr double kSafety = 0.5;  // of the stability limit of the body at rest: springs stiffen under load
  step_ = time.step;
  if (step_ == 0)
    step_ = integrator.is_explicit ? kSafety * stable_step(model_, forces_, initial_state(model_))
                                   : time.end / kDefaultSteps;
}

/// From the state at hand, with nothing kept of steps before.
void Simulation::begin_stepping() {
  const TimeOptions& time = scene_.time;
  report_.tolerance.reset();
  if (time.mode == TimeMode::Static) {
    equilibrium_ = std::make_unique<QuasiStaticSolver>(model_, forces_, time.residual);
    report_.tolerance = time.residual;
    return;
  }
  n_holding_ = n_holding_at(scene_, state_.t);
  forces_.constraints = constraints_of(problem_, surface_of(model_), state_.t);
  options_.gradients = {time.volume_gradient, time.bend_gradient};
  options_.linear_solver = time.linear_solver;
  if (scene_.is_paper) options_.curvature = Curvature::ExactButAngles;
  options_.tolerance = time.tolerance;
  options_.residual = time.residual;
  options_.sleep_below = time.sleep_below;
  stepper_ = std::make_unique<TimeStepper>(model_, forces_, time.integrator, time.end, options_, contacts_);
  if (!state_.ledger.has_begun())
    state_.ledger.begin(kinetic_energy(model_, state_.v), elastic_energy(model_, state_),
                        stepper_->surface_at(state_), state_.x, rounding_of_energy(model_, forces_));
  const Integrator& integrator = find_integrator(time.integrator);
  if (model_.linear && !integrator.is_explicit)
    report_.tolerance = ConstantMatrix::kTolerance;
  else if (integrator.is_linearised)
    report_.tolerance = options_.linear_tolerance;
  else if (integrator.minimises())
    report_.tolerance =
        contacts_.bodies.empty() && !contacts_.self_thickness ? time.residual : ImplicitStage::kStepTolerance;
}

/// Of the whole run, those from the state at hand on of the present length.
void Simulation::count_steps() {
  report_.n_steps = scene_.time.load_steps;
  if (!is_static()) report_.n_steps = meshing::n_steps_from(scene_.time, step_, state_.t, state_.n_done);
}

void Simulation::set_state(const State& state) {
  if (state.x.cols() != model_.network.X.cols())
    throw std::runtime_error("a state of " + std::to_string(state.x.cols()) + " nodes, expected " +
                             std::to_string(model_.network.X.cols()));
  if (state.n_events != state_.n_events)
    turn_to(state.n_events == 0 ? first_ : *first_.events.at(state.n_events - 1).after);
  state_ = state;
  report_.status = Status::Ok;
  report_.n_unsolved = 0;
  begin_stepping();
  if (!is_static())
    remember(state.history.surface, stepper_->surface_at(state_));
  else if (state.loading)
    remember(state.loading->surface, forces_.surface);
  count_steps();
}

std::string Simulation::saved() const {
  if (is_static()) return "";
  Archive to;
  State state = state_;
  SimulationReport counts = report_;
  to(state, counts);
  stepper_->archive_kept(to);
  return std::move(to).bytes();
}

void Simulation::restore(const std::string& saved) {
  Archive from(saved);
  State state;
  from(state);
  set_state(state);
  from(report_);
  stepper_->archive_kept(from);
}

void Simulation::change(const Scene& scene) {
  const double before = elastic_energy(model_, state_);
  turn_to(scene);
  if (!is_static())
    state_.ledger.change(elastic_energy(model_, state_) - before, stepper_->surface_at(state_), state_.x,
                         rounding_of_energy(model_, forces_));
}

void Simulation::obey_events() {
  constexpr double kRounding = 1e-6;  // of a step, of the sum of those so far
  const double now = state_.t + kRounding * (is_static() ? 1. / report_.n_steps : step_);
  const std::vector<Event>& events = first_.events;
  for (; state_.n_events < static_cast<int>(events.size()) && events[state_.n_events].time <= now;
       ++state_.n_events)
    change(*events[state_.n_events].after);
}

void Simulation::turn_to(const Scene& scene) {
  const std::set<std::string> changed = changed_keys(scene_, scene);
  bool is_new_model = false, is_new_force = false;
  for (const std::string& key : changed) {
    is_new_model |= key == "material.E" || key == "material.nu" || key == "time.integrator";
    is_new_force |= !is_of(key, "collapse") && !is_of(key, "reference");
    if (is_of(key, "obstacles")) {  // which are not where they were
      state_.history.active_set.clear();
      state_.history.clearance.clear();
    }
  }
  is_new_model |= scene.collapse && model_.tet_springs && model_.tet_springs->weight.size() == 0;
  is_new_force |= is_new_model;
  scene_ = scene;
  report_.status = Status::Ok;
  report_.n_unsolved = 0;
  if (!is_new_model) find_collapsing();
  if (!is_new_force) return;
  problem_ = discretise(scene_, surface_of(network_));
  if (is_new_model) make_model();
  act_on_model();
  begin_stepping();
  count_steps();
}

bool Simulation::has_ended() const {
  return state_.n_done >= report_.n_steps || report_.status >= Status::StrainTooLarge ||
         report_.n_unsolved >= (is_static() ? 1 : kMostUnsolved);
}

void Simulation::set_target_volume(double t) {
  if (!scene_.volume) return;
  const Eigen::Matrix3Xi& F = model_.network.F;
  state_.target_volume = target_volume_of(scene_, volume(model_.network.X, F)).at(t, volume(state_.x, F));
}

/// Where supports have ended, steps begin anew with those that are left.
void Simulation::release_nodes() {
  if (n_holding_at(scene_, state_.t) == n_holding_) return;
  state_.history.x.resize(3, 0);
  begin_stepping();
}

StepReport Simulation::take_step() {
  if (is_static()) {
    const double load_factor = static_cast<double>(state_.n_done + 1) / report_.n_steps;
    if (scene_.collapse) collapse_to(*scene_.collapse, model_, load_factor, state_);
    set_target_volume(load_factor);
    StepReport step = equilibrium_->solve(load_factor, state_);
    report_.solver = equilibrium_->solver_choice();
    state_.t = load_factor;
    return step;
  }
  const bool relaxes = scene_.skin && scene_.skin->relaxation > 0;
  if (scene_.collapse || relaxes) {
    const double before = energy_of_rest_lengths(model_, state_);
    if (scene_.collapse) collapse(*scene_.collapse, model_, step_, state_);
    if (relaxes) relax_surface(scene_.skin->relaxation, model_, scene_.is_paper ? 1 : step_, state_);
    state_.ledger.flows.rest += energy_of_rest_lengths(model_, state_) - before;
  }
  set_target_volume(state_.t + step_);
  const StepReport step = stepper_->step(state_, step_);
  report_.solver = stepper_->solver_choice();
  release_nodes();
  return step;
}

Status Simulation::advance() {
  obey_events();
  const StepReport step = take_step();
  ++state_.n_done;
  report_.newton_iterations += step.newton_iterations;
  report_.linear_iterations += step.linear_iterations;
  report_.n_at_rest += step.is_at_rest;
  report_.n_halved += step.is_halved;
  report_.residual = step.residual;
  report_.status = std::max(report_.status, step.status);
  report_.n_unsolved = step.status == Status::NotConverged ? report_.n_unsolved + 1 : 0;
  if (report_.status != Status::Diverged && is_check_due()) {
    check_strain();
    if (!is_static()) check_energy();
  }
  if (step.status == Status::Ok) return report_.status;
  std::ostringstream reason;
  if (!is_static()) {
    if (report_.n_unsolved < kMostUnsolved) return report_.status;
    reason << "at " << state_.t << " s " << kMostUnsolved << " steps in a row have not converged";
    report_.reason = reason.str();
    return report_.status;
  }
  reason << "load factor " << state_.t << ", step " << state_.n_done << " of " << report_.n_steps << ": "
         << (step.reason.empty() ? name_of(step.status) : step.reason);
  report_.reason = reason.str();
  return step.status;
}

/// Steps that solve nothing anew cost as little as a sum of energies, so these are taken now and then.
bool Simulation::is_check_due() const {
  constexpr int kEvery = 16;
  const bool is_cheap = stepper_ && (model_.linear || find_integrator(scene_.time.integrator).is_explicit);
  return !is_cheap || state_.n_done % kEvery == 0 || state_.n_done == report_.n_steps;
}

void Simulation::check_energy() {
  state_.ledger.settle(kinetic_energy(model_, state_.v), elastic_energy(model_, state_));
  if (!state_.ledger.has_gained()) return;
  report_.status = Status::EnergyGained;
  std::ostringstream reason;
  reason << "at " << state_.t << " s the body has gained " << 100 * state_.ledger.gain()
         << " % of its largest energy from nothing; a shorter time.step or another time.integrator may not";
  report_.reason = reason.str();
}

void Simulation::check_strain() {
  if (!model_.linear || model_.network.T.cols() == 0) return;
  const double strain = largest_mean_strain(model_.network.X, model_.network.T, displacement(model_, state_));
  if (!(strain > meshing::kLargestSmallStrain)) return;
  report_.status = Status::StrainTooLarge;
  std::ostringstream reason;
  reason << "small strain reaches " << strain << ", expected at most " << meshing::kLargestSmallStrain
         << "; material.law = \"neo_hookean\" holds beyond";
  report_.reason = reason.str();
}

Snapshot Simulation::snapshot() const {
  const Eigen::Matrix3Xd& X = model_.network.X;
  Snapshot snapshot{state_.t,
                    load_factor(),
                    displacement(model_, state_),
                    kinetic_energy(model_, state_.v),
                    elastic_energy(model_, state_),
                    {}};
  const Eigen::Matrix4Xi& T = model_.network.T;
  if (T.cols() > 0)
    snapshot.strains.emplace_back("max_strain", model_.linear ? largest_linear_strain(X, T, snapshot.u)
                                                              : largest_strain(X, T, snapshot.u));
  if (T.cols() > 0 && !model_.linear) {
    if (model_.tet_springs)
      snapshot.strains.emplace_back("min_J", smallest_jacobian(*model_.tet_springs, snapshot.u));
    snapshot.strains.emplace_back("min_J_nodes", smallest_jacobian(X, T, snapshot.u));
  }
  if (model_.springs)
    snapshot.strains.emplace_back("max_spring_strain",
                                  model_.linear ? largest_linear_strain(X, model_.springs->E, snapshot.u)
                                                : largest_strain(*model_.springs, X, state_.x));
  const SurfaceEnergies surface = is_static() ? forces_.surface : stepper_->surface_at(state_);
  snapshot.contact = contact_columns(surface, state_.x, Eigen::Matrix3d::Identity());
  if (is_static()) return snapshot;
  snapshot.fields.push_back({"velocity", state_.v});
  snapshot.ledger = state_.ledger.columns(surface, snapshot.kinetic_energy, snapshot.elastic_energy);
  return snapshot;
}

}  // namespace testbed::massspring
