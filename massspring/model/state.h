// What changes in a run. A run that begins from a state goes on as the one that it was taken from.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "meshing/algebra/load_path.h"
#include "meshing/surface_energies/energy_ledger.h"

namespace testbed::massspring {

/// A node that the linearised scheme constrains to an obstacle.
struct Touch {
  int node, body;
  bool is_stuck;
  Eigen::Vector3d friction;  ///< of the next step where it slides (N)
};

/// What steps in time leave to later ones; empty where nothing asks for it.
struct StepHistory {
  double t = 0, h = 0;                     ///< s: the last step's beginning and length
  Eigen::Matrix3Xd x, v;                   ///< as it began (m, m/s)
  double part = 0;                         ///< s: length of the next part of a step; 0: not yet known
  std::vector<Touch> active_set;           ///< ascending nodes, one each
  std::vector<Eigen::VectorXd> clearance;  ///< per body and node, what it may go before it is looked at (m)
  meshing::SurfaceMemories surface;
};

inline void archive(meshing::Archive& a, Touch& touch) {
  a(touch.node, touch.body, touch.is_stuck, touch.friction);
}
inline void archive(meshing::Archive& a, StepHistory& history) {
  a(history.t, history.h, history.x, history.v, history.part);
  a(history.active_set, history.clearance, history.surface);
}

/// What load steps leave to later ones.
struct LoadHistory {
  meshing::LoadPath path;                    ///< of displacements (m)
  Eigen::VectorXd rest_length, patch_scale;  ///< as in State, at the last equilibrium
  double target_volume;
  meshing::SurfaceMemories surface;
};

struct State {
  double t = 0;        ///< s; static scenes: load factor
  Eigen::Matrix3Xd x;  ///< positions (m)
  Eigen::Matrix3Xd u;  ///< displacements (m) without the rounding of x; empty: x less positions at rest
  Eigen::Matrix3Xd v;  ///< velocities (m/s)
  Eigen::VectorXd rest_length;  ///< m per independent spring
  Eigen::VectorXd patch_scale;  ///< length of the rest shape of each patch of coupled springs; empty: ones
  double target_volume = 0;     ///< of the global volume force (m3)
  int n_done = 0;               ///< load or time steps
  int n_events = 0;             ///< of the scene, that have been obeyed
  StepHistory history;
  meshing::EnergyLedger ledger;        ///< of motion
  std::optional<LoadHistory> loading;  ///< absent: at rest
};

/// Of motion: without what load steps leave.
inline void archive(meshing::Archive& a, State& state) {
  a(state.t, state.x, state.u, state.v, state.rest_length, state.patch_scale, state.target_volume);
  a(state.n_done, state.n_events, state.history, state.ledger);
}

}  // namespace testbed::massspring
