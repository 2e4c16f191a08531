// Bars in contact as the reference steps them, and how its runs are compared.
#pragma once

#include <gtest/gtest.h>

#include "fem_reference/solid/simulation.h"
#include "tests/meshing/two_bars.h"

namespace testbed::fem {

constexpr double kStep = 2e-3;            // s
constexpr int kBefore = 31, kAfter = 15;  // steps: the bars meet after some 26

struct Bars : meshing::BarsInContact {
  StageTimer timer;
  explicit Bars(const std::string& integrator, int degree = 1) : BarsInContact(kStep) {
    scene.reference.integrator = integrator;
    scene.reference.degree = degree;
    scene.self_contact.friction = 0.3;
  }
  /// Nothing is left but the body.
  void remove_contact() {
    scene.obstacles.clear();
    scene.self_contact = {};
    scene.volume.reset();
    scene.skin.reset();
  }
  Simulation simulation() { return simulation_of(scene); }
  Simulation simulation_of(const Scene& other) { return {other, {mesh.X, mesh.F}, mesh, timer}; }
};

inline Simulation& after(int n_steps, Simulation& simulation) {
  for (int n = 0; n < n_steps; ++n) EXPECT_EQ(simulation.advance(), Status::Ok);
  return simulation;
}

/// Largest distance of a node in two runs (m).
inline double apart(const Simulation& a, const Simulation& b) {
  return (a.snapshot().u - b.snapshot().u).colwise().norm().maxCoeff();
}

/// A column of the ledger (J).
inline double column_of(const Simulation& simulation, const std::string& name) {
  for (const auto& [column, value] : simulation.snapshot().ledger)
    if (column == name) return value;
  throw std::runtime_error("no column " + name);
}

}  // namespace testbed::fem
