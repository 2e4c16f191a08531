// The springs of the paper's Table 1 beside Bullet's: same nodes, springs, stiffness, masses and step,
// gravity, the lowest fifth constrained.
#include <BulletCollision/BroadphaseCollision/btDbvtBroadphase.h>
#include <BulletSoftBody/btDeformableBodySolver.h>
#include <BulletSoftBody/btDeformableGravityForce.h>
#include <BulletSoftBody/btDeformableMassSpringForce.h>
#include <BulletSoftBody/btDeformableMultiBodyConstraintSolver.h>
#include <BulletSoftBody/btDeformableMultiBodyDynamicsWorld.h>
#include <BulletSoftBody/btSoftBody.h>
#include <BulletSoftBody/btSoftBodyRigidBodyCollisionConfiguration.h>
#include <benchmark/benchmark.h>

#include "massspring/time/integrators.h"
#include "tests/benchmark/table_1.h"

namespace {

using namespace testbed;
using namespace testbed::massspring;

constexpr double kGravity = -9.81, kSoft = 1e5, kStiff = 1e8;  // m/s2, Pa
constexpr int kWarmUp = 3;

bool is_constrained(const MassSpringModel& model, Eigen::Index i) {
  const auto z = model.network.X.row(2);
  return z(i) < z.minCoeff() + (z.maxCoeff() - z.minCoeff()) / 5;
}

/// Half the stable step for explicit schemes, a frame for implicit ones (s).
double step_of(const MassSpringModel& model, bool is_implicit) {
  constexpr double kFrame = 1. / 60;
  Forces forces;
  return is_implicit ? kFrame : 0.5 * stable_step(model, forces, initial_state(model));
}

void ours(benchmark::State& bench, const Table1& row, double E, bool is_implicit) {
  const MassSpringModel model = make_model(row, E);
  Forces forces;
  forces.load = Eigen::Vector3d(0, 0, kGravity) * model.mass.transpose();
  for (Eigen::Index i = 0; i < model.mass.size(); ++i)
    if (is_constrained(model, i))
      forces.constraints.push_back({static_cast<int>(i), Eigen::Matrix3d::Zero(), Eigen::Vector3d::Zero()});
  const double h = step_of(model, is_implicit);
  TimeStepper stepper(model, forces, is_implicit ? "implicit_euler" : "symplectic_euler", 1, {1e-4});
  State state = initial_state(model);
  for (int n = 0; n < kWarmUp; ++n) stepper.step(state, h);
  for (auto _ : bench) stepper.step(state, h);
  bench.counters["FPS"] =
      benchmark::Counter(static_cast<double>(bench.iterations()), benchmark::Counter::kIsRate);
  State frame = initial_state(model);
  while (frame.t < 0.1) stepper.step(frame, h);
  bench.counters["sag"] = (model.network.X - frame.x).row(2).maxCoeff();
}

/// Springs of Bullet have one stiffness, as those of the uniform model have.
void bullet(benchmark::State& bench, const Table1& row, double E, bool is_implicit) {
  const MassSpringModel model = make_model(row, E);
  const auto n = static_cast<int>(model.mass.size());
  const double h = step_of(model, is_implicit);
  btSoftBodyRigidBodyCollisionConfiguration configuration;
  btCollisionDispatcher dispatcher(&configuration);
  btDbvtBroadphase broadphase;
  btDeformableBodySolver solver;
  btDeformableMultiBodyConstraintSolver constraints;
  constraints.setDeformableSolver(&solver);
  btDeformableMultiBodyDynamicsWorld world(&dispatcher, &broadphase, &constraints, &configuration, &solver);
  const btVector3 gravity(0, 0, kGravity);
  world.setGravity(gravity);
  world.getWorldInfo().m_gravity = gravity;
  world.setImplicit(is_implicit);
  world.setUseProjection(true);
  const auto make_body = [&] {
    std::vector<btVector3> x(n);
    for (int i = 0; i < n; ++i)
      x[i] = btVector3(model.network.X(0, i), model.network.X(1, i), model.network.X(2, i));
    auto* body = new btSoftBody(&world.getWorldInfo(), n, x.data(), nullptr);
    for (const auto& s : model.springs->E.colwise()) body->appendLink(s(0), s(1));
    for (int i = 0; i < n; ++i) body->setMass(i, is_constrained(model, i) ? 0 : model.mass(i));
    world.addSoftBody(body);
    return body;
  };
  btSoftBody* body = make_body();
  btDeformableMassSpringForce springs(model.springs->stiffness(0), 0, true);
  btDeformableGravityForce weight(gravity);
  world.addForce(body, &springs);
  world.addForce(body, &weight);
  double t = 0, sag = 0;
  const auto advance = [&] {
    world.stepSimulation(h, 0);
    t += h;
  };
  while (t < 0.1) advance();
  for (int i = 0; i < n; ++i) sag = std::max(sag, model.network.X(2, i) - body->m_nodes[i].m_x.z());
  bench.counters["sag"] = sag;
  for (auto _ : bench) advance();
  bench.counters["FPS"] =
      benchmark::Counter(static_cast<double>(bench.iterations()), benchmark::Counter::kIsRate);
  world.removeSoftBody(body);
  delete body;
}

}  // namespace

int main(int argc, char** argv) {
  for (const Table1& row : kModels)
    for (const bool is_implicit : {false, true})
      for (const double E : {kSoft, kStiff}) {
        const std::string name = std::string("/") + row.shape + (is_implicit ? "/implicit" : "/explicit") +
                                 (E == kSoft ? "/soft" : "/stiff");
        if (!is_implicit && E == kStiff) continue;  // the same work, in shorter steps
        benchmark::RegisterBenchmark(("ours" + name).c_str(), ours, row, E, is_implicit);
        benchmark::RegisterBenchmark(("bullet" + name).c_str(), bullet, row, E, is_implicit);
      }
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
}
