// A bar hangs from one end, then its support lets go: an equilibrium, then steps in time from it.
#include <cmath>
#include <cstdio>

#include "massspring/calibrations/calibrate.h"
#include "massspring/statics/quasi_static.h"
#include "massspring/time/integrators.h"
#include "meshing/network/build_network.h"

int main() {
  using namespace testbed;
  using namespace testbed::massspring;

  // 1. The scene: a bar, constrained at x = 0, whose weight pulls along x.
  Scene scene;
  scene.material.E = 1e6;
  scene.surface.shape = "bar";
  scene.surface.n_vertices = 200;
  scene.gravity = Eigen::Vector3d(9.81, 0, 0);
  Support support;
  support.region = {HalfSpace{{0, 0, 0}, {1, 0, 0}}, true};  // coordinates relative to the bounding box
  scene.supports = {support};

  // 2. The body: nodes and tetrahedra on the surface, springs that stand for the material.
  const SurfaceMesh surface = load_surface(scene.surface);
  const SpringNetwork network = build_network(surface, scene.network, false, true);
  const MassSpringModel model = calibrate(network, scene.material, find_calibration("node_averaged"));
  Forces forces = forces_of(scene, discretise(scene, surface_of(model)), model);

  // 3. It hangs: full load in one step. A bar of density rho stretches by rho g L^2 / (2 E).
  State state = initial_state(model);
  QuasiStaticSolver equilibrium(model, forces);
  if (equilibrium.solve(1, state).status != Status::Ok) return 1;
  const double length = surface.X.row(0).maxCoeff() - surface.X.row(0).minCoeff();
  const double expected = scene.material.rho * 9.81 * length * length / (2 * scene.material.E);
  const double stretch = (state.x - model.network.X).row(0).maxCoeff();
  std::printf("it stretches by %.4f m, a bar by %.4f m\n", stretch, expected);

  // 4. The support lets go: nothing is constrained from now on.
  forces.constraints.clear();
  TimeStepper stepper(model, forces, "midpoint", 1);
  const auto centre = [&] { return state.x.row(0).dot(model.mass) / model.mass.sum(); };
  const double start = centre(), h = 1e-3;
  state.t = 0;
  while (state.t < 0.1 - h / 2) stepper.step(state, h);

  // 5. Whatever its parts do, the centre of mass falls by g t^2 / 2.
  const double fall = centre() - start, free_fall = 9.81 * 0.1 * 0.1 / 2;
  std::printf("its centre falls by %.6f m, a stone by %.6f m\n", fall, free_fall);
  return std::abs(stretch - expected) < 0.1 * expected && std::abs(fall - free_fall) < 1e-6 ? 0 : 1;
}
