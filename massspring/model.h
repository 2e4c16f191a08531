// The mass-spring solid: what is constant in a run, what changes, and the forces that act on it.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "massspring/springs.h"
#include "massspring/tet_springs.h"
#include "meshing/mesh.h"
#include "meshing/scene.h"

namespace testbed {

struct MassSpringModel {
  SpringNetwork network;
  Material material;
  Eigen::VectorXd mass;                   ///< kg per node
  std::optional<Springs> springs;         ///< independent springs
  std::optional<TetSprings> tet_springs;  ///< springs coupled within tetrahedra
};

struct State {
  double t = 0;                 ///< s; static scenes: load factor
  Eigen::Matrix3Xd x;           ///< positions (m)
  Eigen::Matrix3Xd v;           ///< velocities (m/s)
  Eigen::VectorXd rest_length;  ///< m per spring
  double target_volume = 0;     ///< of the global volume force (m3)
};

/// How a step ended. Divergence is data, not an exception.
enum class Status { Ok, NotConverged, Diverged };
const char* name_of(Status status);

struct StepReport {
  Status status = Status::Ok;
  int newton_iterations = 0;
  int linear_iterations = 0;
  double residual = 0;  ///< of the last linear solve (dynamic) or of the balance of forces (static), relative
};

/// The model at rest.
State initial_state(const MassSpringModel& model);

/// A node that may not move freely: S = I - sum p p^T over the directions p taken away [paper 3.2].
struct Constraint {
  int node;
  Eigen::Matrix3d S;
  Eigen::Vector3d displacement;  ///< at full load, along the directions taken away (m)
};

/// Everything that acts on the model in a scene.
struct Forces {
  Eigen::Matrix3Xd load;                  ///< gravity and surface loads at full strength (N), 3 x n
  double mass_damping = 0;                ///< 1/s: force -mass_damping m v
  std::optional<double> volume_pressure;  ///< P of the global volume force (Pa)
  std::vector<Constraint> constraints;    ///< at most one per node
};

/// Loads act on the undeformed surface; a triangle's load goes to its three nodes in equal parts.
/// @throws std::runtime_error when a support or load meets no node or triangle.
Forces forces_of(const Scene& scene, const MassSpringModel& model);

/// Elastic energy (J).
double elastic_energy(const MassSpringModel& model, const State& state);

/// Elastic forces (N), 3 x n.
Eigen::Matrix3Xd elastic_forces(const MassSpringModel& model, const State& state);

/// Zero matrix with the pattern of the model's stiffness.
BlockMatrix stiffness_pattern(const MassSpringModel& model);

/// K += Hessian of the elastic energy (N/m).
void add_stiffness(const MassSpringModel& model, const State& state, BlockMatrix& K,
                   Curvature curvature = Curvature::Projected);

/// Springs are all that add_stiffness adds, so that no step needs the matrix.
bool is_springs_alone(const MassSpringModel& model);

/// y_i <- S_i y_i at every constrained node.
void filter(const std::vector<Constraint>& constraints, Eigen::Matrix3Xd& y);

/// A <- S A S + (I - S) d, d the largest diagonal entry: the matrix on the constrained space, regular where A
/// is on that space.
void filter(const std::vector<Constraint>& constraints, BlockMatrix& A);

/// Moves constrained nodes by `fraction` of their prescribed displacement from rest, along the directions
/// taken away only.
void prescribe(const std::vector<Constraint>& constraints, const Eigen::Matrix3Xd& rest, double fraction,
               Eigen::Matrix3Xd& x);

}  // namespace testbed
