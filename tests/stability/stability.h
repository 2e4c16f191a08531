// One cell of the stability map: a small body, badly deformed and let go.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "massspring/calibrations/calibrate.h"
#include "massspring/time/integrators.h"
#include "meshing/base/geometry.h"
#include "meshing/network/network.h"
#include "meshing/surface/shapes.h"
#include "meshing/surface/surface.h"
#include "tests/meshing/box_tets.h"

namespace testbed::massspring {

/// What is tried: a spring model, its law, whether the global volume force acts (P = E), and an integrator.
struct Method {
  std::string name, calibration;
  SpringLaw law;
  bool has_volume_force;
  std::string integrator;
  bool is_papers;
};

inline const std::vector<Method>& methods() {
  static const std::vector<Method> kAll{
      {"explicit_euler", "uniform", SpringLaw::Hooke, true, "explicit_euler", true},
      {"symplectic_euler", "uniform", SpringLaw::Hooke, true, "symplectic_euler", true},
      {"implicit_euler", "uniform", SpringLaw::Hooke, true, "implicit_euler", true},
      {"minimising_definite_springs", "uniform", SpringLaw::Definite, true, "minimising_euler", false},
      {"minimising_edge_coupled", "edge_coupled", SpringLaw::Hooke, false, "minimising_euler", false},
      {"minimising_node_averaged", "node_averaged", SpringLaw::Hooke, false, "minimising_euler", false}};
  return kAll;
}

struct Start {
  std::string name;
  std::function<Eigen::Matrix3Xd(const Eigen::Matrix3Xd& X, Random&)> deform;  ///< X centred, of size 1 m
};

inline Eigen::Matrix3Xd noise(Eigen::Index n, double amplitude, Random& random) {
  Eigen::Matrix3Xd x(3, n);
  for (double& c : x.reshaped()) c = amplitude * (2 * random.uniform() - 1);
  return x;
}

inline const std::vector<Start>& starts() {
  using Eigen::Matrix3Xd;
  const auto scaled = [](double x, double y, double z, double amplitude) {
    return [=](const Matrix3Xd& X, Random& random) -> Matrix3Xd {
      return Eigen::Vector3d(x, y, z).asDiagonal() * X + noise(X.cols(), amplitude, random);
    };
  };
  constexpr double kJitter = 1e-3;  // m: no start is so symmetric that it balances on an edge
  static const std::vector<Start> kAll{
      {"rest", scaled(1, 1, 1, kJitter)},
      {"squashed", scaled(1, 1, 0.5, kJitter)},
      {"crushed", scaled(0.05, 0.05, 0.05, 0.02)},
      {"mirrored", scaled(-1, 1, 1, kJitter)},
      {"flattened", scaled(1, 1, 0, kJitter)},
      {"random", [](const Matrix3Xd& X, Random& random) { return noise(X.cols(), 0.5, random); }}};
  return kAll;
}

/// A ball of PCP springs, 102 nodes, or a jittered cube of tetrahedra, 125 nodes; 1 m, centred.
inline MassSpringModel make_body(const Method& method, double E) {
  Material material;
  material.E = E;
  const Calibration& calibration = find_calibration(method.calibration);
  SpringNetwork network;
  if (calibration.needs_tetrahedra) {
    const TetMesh mesh = box_tets(4, 4, 4, 0.25, 0.1);
    network = {mesh.X, mesh.F, Eigen::Matrix2Xi(2, 0), mesh.T, mesh.n_surface};
  } else {
    SampleOptions sampling;
    sampling.k = 60;
    sampling.phi = sampling.psi = 0.1;
    SurfaceMesh surface = make_shape("ball", 42);
    surface.X *= 0.5;
    network = link_pcp(surface, sample_interior(surface, sampling), {});
  }
  network.X.colwise() -= network.X.rowwise().mean().eval();
  MassSpringModel model = calibrate(network, material, calibration);
  if (model.springs) model.springs->law = method.law;
  return model;
}

struct Outcome {
  /// ok, short (inverted still, but ended early), not_converged, inverted, energy_gained, diverged
  std::string name;
  double t = 0;             ///< where it ended (s)
  double energy_ratio = 0;  ///< largest energy over the first
  double least_patch = 1;   ///< least det F of a patch of coupled springs at the end
  int newton_iterations = 0;
};

constexpr std::uint64_t kSeed = 7;  ///< of the published map's starts

/// Changes a model and what acts on it.
using Change = std::function<void(MassSpringModel&, Forces&)>;

/// Lets the body go for ten crossings of a wave and at least ten steps, though at most 2000 explicit or 100
/// implicit ones.
inline Outcome run_cell(const Method& method, const Start& start, double E, double h,
                        std::uint64_t seed = kSeed, const Change& change = {}) {
  MassSpringModel model = make_body(method, E);
  Forces forces;
  forces.load = Eigen::Matrix3Xd::Zero(3, model.network.X.cols());
  if (method.has_volume_force) add_volume_penalty(E, model, forces);
  if (change) change(model, forces);
  State state = initial_state(model);
  Random random(seed);
  state.x = start.deform(model.network.X, random);

  const auto energy = [&] { return potential(model, forces, state) + kinetic_energy(model, state.v); };
  const auto is_inverted = [&] {
    if (model.tet_springs) {
      for (const auto& tet : model.network.T.colwise())
        if (tet_volume(state.x, tet) <= 0) return true;
      return false;
    }
    return volume(state.x, model.network.F) <= 0;
  };
  const double end = 10 * std::sqrt(model.material.rho / E);
  const int max_steps = find_integrator(method.integrator).is_explicit ? 2000 : 100;
  constexpr double kGain = 1.01;
  TimeStepper stepper(model, forces, method.integrator, 1);
  const double first = energy();
  Outcome outcome{"ok", 0, 1};
  Status worst = Status::Ok;
  for (int n = 0; n < max_steps && (n < 10 || state.t < end) && worst != Status::Diverged; ++n) {
    const StepReport report = stepper.step(state, h);
    worst = std::max(worst, report.status);
    outcome.newton_iterations += report.newton_iterations;
    outcome.energy_ratio = std::max(outcome.energy_ratio, energy() / first);
  }
  outcome.t = state.t;
  if (model.tet_springs)
    outcome.least_patch = smallest_jacobian(*model.tet_springs, state.x - model.network.X);
  if (worst == Status::Diverged)
    outcome.name = "diverged";
  else if (outcome.energy_ratio > kGain)
    outcome.name = "energy_gained";
  else if (worst == Status::NotConverged)
    outcome.name = "not_converged";
  else if (is_inverted())
    outcome.name = state.t < end ? "short" : "inverted";
  return outcome;
}

}  // namespace testbed::massspring
