// Prints values of surface energies as JSON, for test_against_ipctk.py to compare.
#include <iostream>
#include <nlohmann/json.hpp>

#include "meshing/base/random.h"
#include "meshing/surface_energies/barrier.h"
#include "meshing/surface_energies/self_barrier.h"
#include "meshing/surface_energies/self_contact.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using nlohmann::json;

std::vector<double> numbers(const Matrix3Xd& x) {
  return {x.data(), x.data() + x.size()};
}

Matrix3Xd random_points(int n, Random& random) {
  Matrix3Xd x(3, n);
  for (double& c : x.reshaped()) c = random.uniform() - 0.5;
  return x;
}

constexpr double kRange = 3e-3;

/// A node above an oblique plane, pressed down and slid along it.
json barrier_values() {
  constexpr double kKappa = 3e4, kArea = 0.7, kFriction = 0.4, kStep = 0.01;
  const Vector3d normal = Vector3d(1, 2, -2) / 3, along = Vector3d(2, -1, 0) / std::sqrt(5.),
                 point(0.3, -0.1, 2);
  Obstacle obstacle;
  obstacle.shape = HalfSpace{point, normal};
  obstacle.friction = kFriction;
  const std::vector<RigidBody> bodies{RigidBody(obstacle)};
  const double slip = 0.1 * kRange * kStep;  // 0.1 ranges a second
  json values;
  for (const double gap : {0.05, 0.3, 0.7, 0.99})
    for (const double slid : {0.2, 0.9, 3.}) {
      Barrier barrier(Eigen::VectorXd::Constant(1, kArea), kRange, kKappa, bodies);
      Matrix3Xd x = point + gap * kRange * normal;
      const double without_friction = barrier.energy(x);
      SurfaceHessian H;
      barrier.add_hessian(x, H, Curvature::Projected);
      barrier.begin_step(0, kStep, x);
      Matrix3Xd f = Matrix3Xd::Zero(3, 1);
      x.col(0) += slid * slip * along;
      barrier.add_forces(x, f);
      values.push_back({{"kappa", kKappa * kArea},
                        {"range", kRange},
                        {"gap", gap * kRange},
                        {"slip", slip},
                        {"slid", slid * slip},
                        {"friction", kFriction},
                        {"energy", without_friction},
                        {"energy_slid", barrier.energy(x)},
                        {"force", f.col(0).dot(normal)},
                        {"friction_force", -f.col(0).dot(along)},
                        {"stiffness", normal.dot(H.diagonal[0] * normal)}});
    }
  return values;
}

/// The largest steps of a node towards a plane.
json step_values() {
  Random random(3);
  json values;
  for (int trial = 0; trial < 40; ++trial) {
    const Matrix3Xd r = random_points(3, random);
    const Vector3d normal = r.col(0).normalized();
    Obstacle obstacle;
    obstacle.shape = HalfSpace{r.col(1), normal};
    const std::vector<RigidBody> bodies{RigidBody(obstacle)};
    Matrix3Xd x(3, 1);
    x = r.col(1) + 0.1 * (trial % 4 + 1) * normal;
    const Matrix3Xd dx = 2 * r.col(2);
    values.push_back({{"normal", numbers(normal)},
                      {"point", numbers(r.col(1))},
                      {"x", numbers(x)},
                      {"dx", numbers(dx)},
                      {"step", Barrier(Eigen::VectorXd::Ones(1), kRange, 1, bodies).largest_step(x, dx)}});
  }
  return values;
}

/// Pairs in touch of two triangles that lay far apart at rest.
json pair_values() {
  constexpr double kThickness = 0.3, kYoungs = 1e3;
  Eigen::Matrix3Xi F(3, 2);
  F << 0, 3, 1, 4, 2, 5;
  Random random(5);
  json values;
  for (int trial = 0; trial < 100; ++trial) {
    Matrix3Xd X = random_points(6, random);
    X.rightCols(3).array() += 100;
    const Matrix3Xd x = random_points(6, random);
    SurfaceContact contact(X, F, kYoungs, kThickness);
    contact.begin_step(0, 1, x);
    SurfaceHessian H;
    contact.add_hessian(x, H, Curvature::Projected);
    double edge = 0;
    for (const auto& t : F.colwise())
      for (int k = 0; k < 3; ++k) edge += (X.col(t(k)) - X.col(t((k + 1) % 3))).norm() / 6;
    json pairs = json::array();
    for (const NearPair& pair : H.pairs) {
      Vector3d e = Vector3d::Zero();
      for (int a = 0; a < 4; ++a) e += pair.weight[a] * x.col(pair.node[a]);
      pairs.push_back(
          {{"node", pair.node}, {"distance", e.norm()}, {"stiffness", pair.stiffness / (kYoungs * edge)}});
    }
    values.push_back({{"rest", numbers(X)},
                      {"x", numbers(x)},
                      {"thickness", kThickness},
                      {"stiffness", kYoungs * edge},
                      {"energy", contact.energy(x)},
                      {"pairs", pairs}});
  }
  return values;
}

/// The barrier between two triangles that lay far apart at rest, and their largest steps.
json self_barrier_values() {
  constexpr double kThickness = 0.3, kYoungs = 1e3;
  Eigen::Matrix3Xi F(3, 2);
  F << 0, 3, 1, 4, 2, 5;
  Random random(6);
  json values;
  for (int trial = 0; trial < 100; ++trial) {
    Matrix3Xd X = random_points(6, random);
    X.rightCols(3).array() += 100;
    const Matrix3Xd x = random_points(6, random), dx = 0.4 * random_points(6, random);
    const SelfBarrier barrier(X, F, kYoungs, kThickness);
    Matrix3Xd f = Matrix3Xd::Zero(3, 6);
    barrier.add_forces(x, f);
    values.push_back({{"rest", numbers(X)},
                      {"x", numbers(x)},
                      {"dx", numbers(dx)},
                      {"thickness", kThickness},
                      {"kappa", kYoungs / (50 * kThickness)},
                      {"energy", barrier.energy(x)},
                      {"forces", numbers(f)},
                      {"step", barrier.largest_step(x, dx)}});
  }
  return values;
}

}  // namespace
}  // namespace testbed::meshing

int main() {
  using namespace testbed::meshing;
  std::cout << nlohmann::json{{"barrier", barrier_values()},
                              {"steps", step_values()},
                              {"pairs", pair_values()},
                              {"self_barrier", self_barrier_values()}};
}
