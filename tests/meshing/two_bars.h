// Two bodies in contact with each other and with an obstacle, which both programs step.
#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <string>
#include <vector>

#include "meshing/scene/scene.h"
#include "tests/meshing/box_tets.h"

namespace testbed::meshing {

/// Two bars of 0.5 m, askew, that lie on a rough floor, shrink around a pivot, have a skin and keep a volume. A support
/// pushes the first into the second.
struct BarsInContact {
  TetMesh mesh;
  Scene scene;

  explicit BarsInContact(double step) {
    using Eigen::Vector3d;
    const TetMesh bar = box_tets(2, 1, 1, 0.25);
    const auto n = static_cast<int>(bar.X.cols());
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(0.2, Vector3d::UnitY()).matrix();
    mesh.X.resize(3, 2 * n);
    mesh.X << bar.X, (turn * bar.X).colwise() + Vector3d(0.53, 0, 0.05);
    mesh.F.resize(3, 2 * bar.F.cols());
    mesh.F << bar.F, (bar.F.array() + n).matrix();
    mesh.T.resize(4, 2 * bar.T.cols());
    mesh.T << bar.T, (bar.T.array() + n).matrix();
    mesh.n_surface = 2 * n;
    scene.material = {1e5, 0.3, 1000, 0};
    scene.material.law = MaterialLaw::NeoHookean;
    scene.gravity = Vector3d(0, -9.81, 0);
    Support push;
    push.region.shape = HalfSpace{Vector3d(1e-3, 0, 0), Vector3d(1, 0, 0)};
    push.motion = {{0, 0, 0, 0}, {1, 1.5, 0, 0}};
    scene.supports = {push};
    Obstacle floor;
    floor.shape = HalfSpace{Vector3d(0, -1e-3, 0), Vector3d(0, 1, 0)};
    floor.friction = 0.5;
    scene.obstacles = {floor};
    scene.self_contact = {true, 0.01};
    scene.volume = VolumeForces{1e4, 0, {{0, 1}, {1, 0.8}}};
    scene.skin = Skin{100, 1e-2, 0.1};
    scene.collapse.emplace();
    scene.collapse->coefficient = 0.5;
    scene.collapse->pivots.push_back({Vector3d(0.5, 0.1, 0.1), {}, 0, {}});
    scene.time.mode = TimeMode::Dynamic;
    scene.time.step = step;
    scene.time.end = 0.1;
  }
};

/// Another value of a scene, under which a run may go on.
struct Change {
  std::string name;
  std::function<void(Scene& scene)> make;
};

/// Of a scene that bears a pressure and a follower, in this order, and shrinks around a pivot.
inline std::vector<Change> changes_of_values() {
  using Eigen::Vector3d;
  return {{"E", [](Scene& scene) { scene.material.E *= 2; }},
          {"nu", [](Scene& scene) { scene.material.nu = 0.4; }},
          {"gravity", [](Scene& scene) { scene.gravity = Vector3d(3, 1, 2); }},
          {"no gravity", [](Scene& scene) { scene.gravity.reset(); }},
          {"pressure", [](Scene& scene) { scene.loads[0].pressure = 500; }},
          {"follower pressure", [](Scene& scene) { scene.loads[1].pressure = 300; }},
          {"depletion", [](Scene& scene) { scene.collapse->coefficient *= 1.8; }},
          {"no collapse", [](Scene& scene) { scene.collapse.reset(); }},
          {"pivot", [](Scene& scene) { scene.collapse->pivots[0].point.x() = 1; }},
          {"another pivot",
           [](Scene& scene) {
             scene.collapse->pivots.push_back({Vector3d(1, 0, 0), {}, 0, {}});
           }},
          {"step", [](Scene& scene) { scene.time.step /= 2; }}};
}

/// What differs of obstacles, the first of which is a floor.
inline std::vector<Change> changes_of_obstacles() {
  return {{"obstacle", [](Scene& scene) { std::get<HalfSpace>(scene.obstacles[0].shape).point.y() -= 0.01; }},
          {"no obstacle", [](Scene& scene) { scene.obstacles.clear(); }}};
}

}  // namespace testbed::meshing
