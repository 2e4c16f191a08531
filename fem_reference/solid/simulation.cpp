#include "fem_reference/solid/simulation.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "fem_reference/solid/central_differences.h"
#include "fem_reference/solid/problem.h"
#include "meshing/scene/initial_motion.h"

namespace testbed::fem {

Simulation::Simulation(const Scene& scene, const SurfaceMesh& surface, const TetMesh& mesh, StageTimer& timer)
    : scene_(scene),
      timer_(timer),
      solid_(assemble_scene(scene, surface, mesh)),
      is_proportional_(is_proportional(scene)),
      n_steps_(scene.time.load_steps) {
  if (scene.time.mode == TimeMode::Dynamic) set_in_motion();
}

MassMatrix Simulation::mass() const {
  return is_explicit() ? MassMatrix::Lumped : scene_.reference.mass;
}

/// Full loads from t = 0 on.
void Simulation::set_in_motion() {
  timer_.start("assemble");
  Dynamics system;
  system.K = solid_.stiffness();
  system.M = solid_.mass(mass());
  system.damping = scene_.material.damping;
  system.stiffness_damping = scene_.material.stiffness_damping;
  system.load = solid_.load();
  std::map<int, int> held;  // the last of the held components of an unknown
  for (size_t k = 0; k < solid_.held().size(); ++k) {
    const HeldComponent& h = solid_.held()[k];
    held[3 * h.node + h.component] = static_cast<int>(k);
  }
  for (const auto& [unknown, k] : held) system.held.push_back(unknown);
  if (scene_.material.damping_ratio > 0) {
    constexpr int kOneVibration = 7;  // behind at most six rigid motions
    const Modes modes = natural_modes(system.K, system.M, system.held, kOneVibration);
    system.damping += 2 * scene_.material.damping_ratio * 2 * M_PI * modes.frequency[modes.n_rigid];
  }
  damping_ = system.damping;
  const bool is_driven = std::any_of(scene_.supports.begin(), scene_.supports.end(), [](const Support& s) {
    return !s.motion.empty() || !s.displacement.isZero(0);
  });
  if (is_driven)
    system.held_motion = [this, held](double t) {
      Eigen::VectorXd u(static_cast<Eigen::Index>(held.size()));
      Eigen::Index i = 0;
      for (const auto& [unknown, k] : held) u(i++) = solid_.held_displacement(k, t);
      return u;
    };
  if (law_of(scene_) != MaterialLaw::SmallStrain)
    system.linearise = [this](const Eigen::VectorXd& u, bool with_tangent) {
      return solid_.linearise(u.reshaped(3, solid_.X().cols()), 1, with_tangent);
    };
  const TimeOptions& time = scene_.time;
  constexpr double kSafety = 0.5;  // of the stability limit of the body at rest, which strain lowers
  step_ = time.step;
  if (step_ == 0) step_ = is_explicit() ? kSafety * stable_step(system) : time.end / kDefaultSteps;
  n_steps_ = meshing::n_steps(time, step_);
  timer_.start("solve");
  const std::optional<double> radius = scene_.reference.spectral_radius;
  if (is_explicit()) {
    system.forces = [this](const Eigen::VectorXd& u, Eigen::Matrix3Xd& force) {
      solid_.find_forces(u.reshaped(3, solid_.X().cols()), 1, force);
    };
    motion_ = std::make_unique<CentralDifferences>(std::move(system), step_);
  } else {
    motion_ = std::make_unique<TimeIntegrator>(std::move(system), step_,
                                               radius ? generalised_alpha(*radius) : kNewmark);
  }
  if (scene_.initial.empty()) return;
  const Eigen::VectorXd mass = solid_.mass(MassMatrix::Lumped).diagonal();
  const Eigen::Matrix3Xd v = initial_velocity(scene_, solid_.X(), mass(Eigen::seq(0, Eigen::last, 3)));
  motion_->restart(Eigen::VectorXd::Zero(v.size()), v.reshaped());
}

bool Simulation::advance() {
  if (motion_) {
    is_converged_ = motion_->step();
  } else if (n_done_ == 0 || !is_proportional_) {
    const double factor = is_proportional_ ? 1 : static_cast<double>(n_done_ + 1) / n_steps_;
    const int n_newton = equilibrium_.newton_iterations, n_linear = equilibrium_.linear_iterations;
    equilibrium_ = solid_.solve(factor, &timer_);
    equilibrium_.newton_iterations += n_newton;
    equilibrium_.linear_iterations += n_linear;
    is_converged_ = equilibrium_.is_converged;
  }
  n_done_ += is_converged_;
  return is_converged_;
}

Snapshot Simulation::snapshot() const {
  if (motion_) {
    const Eigen::Matrix3Xd u = motion_->u().reshaped(3, solid_.X().cols());
    return {motion_->t(),
            1,
            u,
            motion_->kinetic_energy(),
            motion_->elastic_energy(),
            {{"max_strain", solid_.max_strain(u)}},
            {{"velocity", motion_->v().reshaped(3, u.cols())}}};
  }
  const double scale = is_proportional_ ? load_factor() : 1;  // of the solution at full load
  return {load_factor(),
          load_factor(),
          scale * solid_.displacement(),
          0,
          scale * scale * equilibrium_.elastic_energy,
          {{"max_strain", scale * equilibrium_.max_strain}}};
}

std::string Simulation::solver() const {
  if (!motion_) return equilibrium_.solver;
  if (is_explicit()) return "central differences";
  return std::string(scene_.reference.spectral_radius ? "generalised-alpha"
                                                      : "Newmark (average acceleration)") +
         (law_of(scene_) == MaterialLaw::SmallStrain ? "" : ", Newton") + ", Cholesky";
}

}  // namespace testbed::fem
