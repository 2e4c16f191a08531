#include "fem_reference/solid/simulation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>
#include <utility>

#include "fem_reference/solid/natural_modes.h"
#include "fem_reference/solid/problem.h"
#include "meshing/scene/changed_keys.h"
#include "meshing/scene/collapse.h"
#include "meshing/scene/initial_motion.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface_energies/initial_overlap.h"

namespace testbed::fem {

Simulation::Simulation(const Scene& scene, const SurfaceMesh& surface, const TetMesh& mesh, StageTimer& timer)
    : scene_(scene),
      surface_(surface),
      mesh_(mesh),
      timer_(timer),
      frame_(frame_of(scene.supports).value()),
      solid_(assemble_scene(scene, surface, mesh)),
      is_proportional_(is_proportional(scene)),
      n_steps_(scene.time.load_steps) {
  check_apart(scene, solid_);
  if (scene.time.mode == TimeMode::Static) return;
  find_collapsing();
  set_in_motion(0);
  count_steps();
  push_out_of_obstacles();
}

void Simulation::find_collapsing() {
  if (!scene_.collapse) return;
  shortest_side_ = shortest_side(surface_);
  const auto part_at = collapsing_part(*scene_.collapse, surface_);
  const Eigen::Matrix3Xd X = frame_ * solid_.mesh().X;
  collapsing_.resize(X.cols());
  for (Eigen::Index i = 0; i < X.cols(); ++i) collapsing_(i) = part_at(X.col(i));
  if (length_.size() == 0) length_.setOnes(X.cols());
}

void Simulation::count_steps() {
  n_steps_ = meshing::n_steps_from(scene_.time, step_, integrator_->t(), n_done_);
}

/// To equilibrium beside obstacles that it may overlap.
void Simulation::push_out_of_obstacles() {
  if (std::none_of(scene_.obstacles.begin(), scene_.obstacles.end(),
                   [](const Obstacle& obstacle) { return obstacle.initially == Overlap::Resolve; }))
    return;
  std::vector<meshing::RigidBody> obstacles;
  for (const Obstacle& obstacle : scene_.obstacles) obstacles.emplace_back(obstacle, frame_);
  const Share& share = solid_.share();
  const Eigen::Matrix3Xd X = from_first_process(Eigen::MatrixXd(share.written(solid_.X(), solid_.n_nodes())));
  const Eigen::MatrixXi& faces = share.is_whole ? solid_.faces() : share.faces;
  if (scene_.supports.empty()) {
    const Eigen::Vector3d way = way_beside(obstacles, X, faces);
    if (!way.isZero(0))
      integrator_->restart(way.replicate(solid_.X().cols(), 1), Eigen::VectorXd(integrator_->v()));
    return;
  }
  const auto apart = without_overlap(scene_, obstacles, X, faces, frame_);
  if (!apart) return;
  Simulation statics(*apart, surface_, mesh_, timer_);
  while (!statics.has_ended()) statics.advance();
  if (statics.status() != Status::Ok)
    throw std::runtime_error("obstacles.initially = \"resolve\" finds no equilibrium beside obstacles: " +
                             statics.reason());
  integrator_->restart(statics.solid().displacement().reshaped(), integrator_->v());
}

void Simulation::set_length(Eigen::VectorXd length) {
  length_ = std::move(length);
  solid_.set_shrinkage(1 - length_.array());
}

MassMatrix Simulation::mass() const {
  return scheme().is_explicit() ? MassMatrix::Lumped : scene_.reference.mass;
}

/// The last of the constrained components of each unknown that supports hold at t.
std::map<int, int> Simulation::constrained_at(double t) const {
  std::map<int, int> constrained;
  for (size_t k = 0; k < solid_.constrained().size(); ++k) {
    const ConstrainedComponent& h = solid_.constrained()[k];
    if (holds_at(scene_.supports[h.support], t)) constrained[3 * h.node + h.component] = static_cast<int>(k);
  }
  return constrained;
}

/// Of those unknowns; empty where they stay.
std::function<Eigen::VectorXd(double t)> Simulation::motion_of(const std::map<int, int>& constrained) const {
  const bool is_driven = std::any_of(scene_.supports.begin(), scene_.supports.end(), [](const Support& s) {
    return !s.motion.empty() || !s.displacement.isZero(0);
  });
  if (!is_driven) return {};
  return [this, constrained](double t) {
    Eigen::VectorXd u(static_cast<Eigen::Index>(constrained.size()));
    Eigen::Index i = 0;
    for (const auto& [unknown, k] : constrained) u(i++) = solid_.constrained_displacement(k, t);
    return u;
  };
}

/// Where supports have ended, the motion goes on with those that are left.
void Simulation::release_nodes() {
  const auto constrained = constrained_at(integrator_->t());
  if (largest_over_processes(constrained.size() != n_constrained_) == 0) return;
  n_constrained_ = constrained.size();
  std::vector<int> unknowns;
  for (const auto& [unknown, k] : constrained) unknowns.push_back(unknown);
  integrator_->hold(unknowns, motion_of(constrained));
}

/// Under full loads, as the body begins, but with what supports hold at t. Damping and the stable step are those of
/// the body as it was at first.
void Simulation::set_in_motion(double t) {
  timer_.start("assemble");
  Dynamics system = dynamics_of(solid_, mass());
  system.damping = scene_.material.damping;
  system.stiffness_damping = scene_.material.stiffness_damping;
  system.load = solid_.load();
  system.tolerance = scene_.time.residual;
  const auto hold_at = [&](double time) {
    const std::map<int, int> constrained = constrained_at(time);
    n_constrained_ = constrained.size();
    system.constrained.clear();
    for (const auto& [unknown, k] : constrained) system.constrained.push_back(unknown);
    system.constrained_motion = motion_of(constrained);
  };
  hold_at(0);
  if (scene_.material.damping_ratio > 0) {
    const Modes modes = natural_modes(system, solid_, 1);
    system.damping += 2 * scene_.material.damping_ratio * 2 * M_PI * modes.frequency[0];
  }
  damping_ = system.damping;
  if (law_of(scene_) != MaterialLaw::SmallStrain || !solid_.surface().empty()) {
    system.linearise = [this](const Eigen::VectorXd& u, bool with_tangent) {
      return solid_.linearise(u.reshaped(3, solid_.X().cols()), 1, with_tangent);
    };
    system.potential = [this](const Eigen::VectorXd& u) {
      return solid_.energy(u.reshaped(3, solid_.X().cols()));
    };
    system.surface = solid_.surface();
    system.X = solid_.X();
  }
  const TimeOptions& time = scene_.time;
  constexpr double kSafety = 0.5;  // of the stability limit of the body at rest, which strain lowers
  step_ = time.step;
  if (step_ == 0)
    step_ = scheme().is_explicit() ? kSafety * scheme().longest_step(system) : time.end / kDefaultSteps;
  hold_at(t);
  timer_.start("solve");
  system.forces = [this](const Eigen::VectorXd& u, Eigen::Matrix3Xd& force) {
    solid_.find_forces(u.reshaped(3, solid_.X().cols()), 1, force);
  };
  integrator_ = scheme().make(std::move(system), step_, scene_.reference);
  if (scene_.initial.empty()) return;
  const Eigen::VectorXd mass = solid_.mass(MassMatrix::Lumped).diagonal();
  const Eigen::Matrix3Xd v =
      frame_.transpose() * initial_velocity(scene_, frame_ * solid_.X(), mass(Eigen::seq(0, Eigen::last, 3)),
                                            meshing::box_of(surface_.X),
                                            [](const auto& sums) { sum_over_processes(sums); });
  integrator_->restart(Eigen::VectorXd::Zero(v.size()), v.reshaped());
}

State Simulation::state() const {
  if (integrator_) return {n_done_, integrator_->state(), {}, length_, {}};
  return {n_done_, {}, solid_.state(), {}, equilibrium_};
}

std::string Simulation::saved() const {
  if (!integrator_ || processes().n > 1) return "";
  Archive to;
  State state = this->state();
  StepCounts counts = integrator_->counts();
  to(state.n_done, state.motion, state.length, counts);
  return std::move(to).bytes();
}

void Simulation::restore(const std::string& saved) {
  Archive from(saved);
  State state;
  StepCounts counts;
  from(state.n_done, state.motion, state.length, counts);
  set_state(state);
  integrator_->set_counts(counts);
}

void Simulation::set_state(const State& state) {
  if ((integrator_ != nullptr) == state.statics.has_value())
    throw std::runtime_error("a state of the other time.mode");
  n_done_ = state.n_done;
  status_ = Status::Ok;
  equilibrium_ = state.equilibrium;
  if (!integrator_) {
    is_solved_ = is_proportional_ && n_done_ > 0;
    scale_ = is_proportional_ ? load_factor() : 1;
    return solid_.set_state(*state.statics);
  }
  if (state.length.size() > 0)
    set_length(state.length);
  else if (length_.size() > 0)  // nothing had collapsed yet
    set_length(Eigen::VectorXd::Ones(length_.size()));
  integrator_->set_state(state.motion);
  release_nodes();
  integrator_->set_state(state.motion);
  count_steps();
}

void Simulation::change(const Scene& scene) {
  std::set<std::string> changed = meshing::changed_keys(scene_, scene);
  changed.erase("time.integrator");  // that of springs
  check_scheme(scene, scene.name);
  if (const std::string part = unmodelled_part(scene); !part.empty())
    throw std::runtime_error("the reference cannot go on with " + part);
  const bool is_new_solid = std::any_of(changed.begin(), changed.end(), [&](const std::string& key) {
    return !meshing::is_of(key, "collapse") || !integrator_ || scene.volume;
  });
  if (is_new_solid) {
    ElasticSolid solid = assemble_scene(scene, surface_, mesh_);
    if (!integrator_) solid.set_state(solid_.state());
    solid_ = std::move(solid);
  }
  scene_ = scene;
  status_ = Status::Ok;
  reason_.clear();
  if (!integrator_) {
    is_proportional_ = is_proportional(scene_);
    is_solved_ = false;
    return;
  }
  find_collapsing();
  if (!is_new_solid) return;
  const std::unique_ptr<Integrator> before = std::move(integrator_);
  set_in_motion(before->t());
  if (length_.size() > 0) set_length(length_);
  integrator_->take_over(*before);
  count_steps();
}

/// As the step at hand begins, and for all of it.
void Simulation::collapse() {
  Eigen::VectorXd length = length_;
  const Eigen::Matrix3Xd u = integrator_->u().reshaped(3, solid_.X().cols()).leftCols(length.size());
  collapse_in_step(*scene_.collapse, shortest_side_, collapsing_, frame_ * (solid_.mesh().X + u),
                   integrator_->t(), step_, length);
  set_length(std::move(length));
}

Status Simulation::advance() {
  status_ = Status::Ok;
  if (integrator_) {
    const Eigen::VectorXd before = length_;
    if (scene_.collapse) integrator_->change_rest([this] { collapse(); });
    if (!integrator_->advance()) {
      if (scene_.collapse) set_length(before);
      return status_ = scheme().is_explicit() ? Status::Diverged : Status::NotConverged;
    }
    release_nodes();
  } else if (!is_solved_) {
    const double factor = is_proportional_ ? 1 : static_cast<double>(n_done_ + 1) / n_steps_;
    const int n_newton = equilibrium_.newton_iterations, n_linear = equilibrium_.linear_iterations;
    equilibrium_ = solid_.solve(factor, &timer_);
    equilibrium_.newton_iterations += n_newton;
    equilibrium_.linear_iterations += n_linear;
    if (!equilibrium_.is_converged) {
      reason_ = law_of(scene_) == MaterialLaw::SmallStrain
                    ? "the linear system's conjugate gradients stand still"
                : equilibrium_.is_definite ? "no equilibrium was found in this load step"
                                           : "no stable equilibrium was found in this load step: the body "
                                             "buckles, or elements turn inside out";
      return status_ = Status::NotConverged;
    }
    is_solved_ = is_proportional_;
  }
  ++n_done_;
  if (!integrator_) scale_ = is_proportional_ ? load_factor() : 1;
  constexpr int kEvery = 16;  // steps, where a sum over the body costs as much as a step
  const bool is_due = n_done_ % kEvery == 0 || n_done_ == n_steps_;
  const bool is_small = law_of(scene_) == MaterialLaw::SmallStrain;
  if (is_small && (is_due || !integrator_)) check_strain();
  if (integrator_ && (is_due || !(is_small || scheme().is_explicit()))) check_balance();
  return status_;
}

void Simulation::check_balance() {
  integrator_->settle();
  if (!integrator_->ledger().has_gained()) return;
  status_ = Status::EnergyGained;
  std::ostringstream reason;
  reason
      << "at " << integrator_->t() << " s the body has gained " << 100 * integrator_->ledger().gain()
      << " % of its largest energy from nothing; a shorter time.step or another reference.integrator may not";
  reason_ = reason.str();
}

void Simulation::check_strain() {
  const double strain = integrator_ ? solid_.max_strain(integrator_->u().reshaped(3, solid_.X().cols()))
                                    : equilibrium_.max_strain * scale_;
  if (!(strain > meshing::kLargestSmallStrain)) return;
  status_ = Status::StrainTooLarge;
  std::ostringstream reason;
  reason << "small strain reaches " << strain << ", expected at most " << meshing::kLargestSmallStrain
         << "; material.law = \"neo_hookean\" holds beyond";
  reason_ = reason.str();
}

std::vector<std::pair<std::string, double>> Simulation::strains(const Eigen::Matrix3Xd& u,
                                                                double max_strain) const {
  std::vector<std::pair<std::string, double>> strains{{"max_strain", max_strain}};
  if (law_of(scene_) == MaterialLaw::SmallStrain) return strains;
  const SmallestJacobians smallest = solid_.smallest_jacobians(u);
  strains.emplace_back("min_J", smallest.at_points);
  strains.emplace_back("min_J_nodes", smallest.at_nodes);
  return strains;
}

Snapshot Simulation::snapshot() const {
  const auto contact_at = [&](const Eigen::Matrix3Xd& u) {
    return meshing::contact_columns(solid_.surface(), solid_.X() + u, frame_);
  };
  const auto seen = [&](const Eigen::Matrix3Xd& field) -> Eigen::Matrix3Xd {
    return frame_ * solid_.share().written(field, n_surface());
  };
  const auto largest_of = [&](const Eigen::Matrix3Xd& u) {
    std::optional<double> largest;
    if (!solid_.share().is_whole) largest = largest_over_processes(u.colwise().norm().maxCoeff());
    return largest;
  };
  if (integrator_) {
    const Eigen::Matrix3Xd u = integrator_->u().reshaped(3, solid_.X().cols());
    Eigen::Matrix3Xd v = integrator_->v().reshaped(3, u.cols());
    solid_.share().exchange.update(v);
    const double kinetic = integrator_->kinetic_energy(), elastic = integrator_->elastic_energy();
    return {integrator_->t(),
            1,
            seen(u),
            kinetic,
            elastic,
            strains(u, solid_.max_strain(u)),
            {{"velocity", seen(v)}},
            contact_at(u),
            integrator_->ledger().columns(integrator_->surface(), kinetic, elastic),
            largest_of(u)};
  }
  const Eigen::Matrix3Xd& u = solid_.displacement();
  return {load_factor(),
          load_factor(),
          seen(scale_ * u),
          0,
          scale_ * scale_ * equilibrium_.elastic_energy,
          strains(u, scale_ * equilibrium_.max_strain),
          {},
          contact_at(u),
          {},
          largest_of(scale_ * u)};
}

std::string Simulation::solver() const {
  return integrator_ ? integrator_->solver() : equilibrium_.solver;
}

}  // namespace testbed::fem
