// The mass-spring solid: what is constant in a run, what changes, and the forces that act on it.
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "massspring/energies/local_volume.h"
#include "massspring/energies/springs.h"
#include "massspring/energies/tet_springs.h"
#include "massspring/model/mass.h"
#include "massspring/model/small_strain.h"
#include "massspring/model/state.h"
#include "meshing/algebra/status.h"
#include "meshing/base/mesh.h"
#include "meshing/scene/scene.h"
#include "meshing/scene/surface_problem.h"
#include "meshing/surface_energies/bending.h"
#include "meshing/surface_energies/seams.h"
#include "meshing/surface_energies/volume_penalty.h"

namespace testbed::massspring {

struct MassSpringModel {
  TetMesh network;  ///< the nodes, and tetrahedra where a part of the model needs them
  Cuts cuts;        ///< of their surface
  Material material;
  std::vector<int> constrained;                   ///< nodes near which coupled springs are softer
  Eigen::VectorXd mass;                           ///< kg per node
  std::optional<ConsistentMass> consistent_mass;  ///< what of it lies between the nodes; coupled springs only
  std::optional<Springs> springs;                 ///< independent springs
  std::optional<TetSprings> tet_springs;          ///< springs coupled within tetrahedra
  Eigen::VectorXd collapsing;                     ///< part of a collapse that each patch takes; empty: all
  std::optional<Bending> bending;                 ///< of the skin
  std::optional<LocalVolume> local_volume;        ///< of every tetrahedron
  std::optional<Seams> seams;                     ///< between parts of the surface
  std::shared_ptr<const LinearElasticity> linear;  ///< small strain; absent: full geometry
};

/// The elastic energies that a model may have. Each has the verbs energy, add_forces, add_hessian and
/// pairs_of, which is all that sums, matrices and their patterns are made of.
inline constexpr std::tuple kElasticEnergies{&MassSpringModel::springs, &MassSpringModel::tet_springs,
                                             &MassSpringModel::bending, &MassSpringModel::local_volume,
                                             &MassSpringModel::seams};

/// Calls visit(energy) for each energy that the model has, in the order of the list.
template <class Visit>
void for_each_energy(const MassSpringModel& model, const Visit& visit) {
  const auto visit_one = [&](const auto& energy) {
    if (energy) visit(*energy);
  };
  std::apply([&](auto... member) { (visit_one(model.*member), ...); }, kElasticEnergies);
}

/// The nodes on the surface, and their triangles.
SurfaceMesh surface_of(const MassSpringModel& model);

/// Number of energies that the model has.
int n_energies(const MassSpringModel& model);

/// Gives the surface of a model at rest the skin of a scene: what its membrane adds to the springs along its
/// edges, k = stiffness (A_1 + A_2)/|e|^2 [Van Gelder 1998], and bending.
void add_skin(const Skin& skin, MassSpringModel& model);

struct StepReport {
  Status status = Status::Ok;
  int newton_iterations = 0;
  int linear_iterations = 0;
  double residual = 0;  ///< of the last linear solve (dynamic) or of the balance of forces (static), relative
  bool is_at_rest = false;  ///< nothing moved, so that nothing was solved
  bool is_halved = false;   ///< shorter steps took its place, as Newton's method did not end
  std::string reason;       ///< why a static load step found no equilibrium
};

/// Displacements (m) of a state, 3 x n.
Eigen::Matrix3Xd displacement(const MassSpringModel& model, const State& state);

/// The model at rest.
State initial_state(const MassSpringModel& model);

/// A node that may not move freely: S = I - sum p p^T over the directions p taken away [paper 3.2].
struct Constraint {
  int node;
  Eigen::Matrix3d S;
  Eigen::Vector3d displacement;                         ///< at full load, along the directions taken away (m)
  Eigen::Vector3d velocity{0, 0, 0};                    ///< in a step, along the directions taken away (m/s)
  std::array<std::shared_ptr<const Path>, 3> motion{};  ///< of a component over time, instead of displacement
};

/// What a constraint prescribes along the directions taken away (m) at a time t, its displacement being
/// complete at `end`.
Eigen::Vector3d prescribed(const Constraint& constraint, double t, double end);

/// p += factor M v, 3 x n.
void add_momenta(const MassSpringModel& model, double factor, const Eigen::Matrix3Xd& v, Eigen::Matrix3Xd& p);

/// M v (kg m/s), 3 x n.
Eigen::Matrix3Xd momenta(const MassSpringModel& model, const Eigen::Matrix3Xd& v);

/// v^T M v / 2 (J).
double kinetic_energy(const MassSpringModel& model, const Eigen::Matrix3Xd& v);

/// Largest |principal stretch - 1| of the tetrahedra T, X (3 x n, m) at rest, under displacements u.
double largest_strain(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Eigen::Matrix3Xd& u);

/// Smallest det F of the tetrahedra, likewise: of their nodes, too, as F is constant.
double smallest_jacobian(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, const Eigen::Matrix3Xd& u);

/// Largest |l/L - 1| of independent springs, L their lengths at positions X.
double largest_strain(const Springs& springs, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xd& x);

/// Blocks of the model's stiffness that are not zero: what a step that forms it must hold.
Eigen::Index n_stiffness_blocks(const MassSpringModel& model);

/// Everything that acts on the model in a scene.
struct Forces {
  Eigen::Matrix3Xd load;                  ///< gravity and dead surface loads at full strength (N), 3 x n
  double mass_damping = 0;                ///< 1/s: force -mass_damping m v
  std::vector<Constraint> constraints;    ///< at most one per node
  SurfaceEnergies surface;                ///< followers, volume and what the surface touches
  std::shared_ptr<VolumePenalty> volume;  ///< the one of them whose target is that of the state
};

/// What supports hold in a step that begins at t (s).
/// @param problem  on the surface
/// @throws std::runtime_error where supports in other directions than those of the axes overlap with others and
/// one of them moves.
std::vector<Constraint> constraints_of(const SurfaceProblem& problem, const SurfaceMesh& surface,
                                       double t = 0);

/// Dead loads act on the undeformed surface; a triangle's load goes to its three nodes in equal parts.
/// @param problem  the scene's, on the model's surface
/// @param t        s, at which steps go on
/// @throws std::runtime_error as constraints_of.
Forces forces_of(const Scene& scene, const SurfaceProblem& problem, const MassSpringModel& model,
                 double t = 0);

/// Adds the global volume force with pressure coefficient P (Pa).
void add_volume_penalty(double P, const MassSpringModel& model, Forces& forces);

/// What acts on the surface, as it does at a state and load factor.
const SurfaceEnergies& surface_at(const Forces& forces, const State& state, double load_factor = 1);

/// Elastic energy (J).
double elastic_energy(const MassSpringModel& model, const State& state);

/// The part of it (J) that rest lengths and scales of patches change.
double energy_of_rest_lengths(const MassSpringModel& model, const State& state);

/// Elastic forces (N), 3 x n.
Eigen::Matrix3Xd elastic_forces(const MassSpringModel& model, const State& state);

/// Energy (J): elastic, of what acts on the surface, and of the loads at `load_factor` times full strength.
double potential(const MassSpringModel& model, const Forces& forces, const State& state,
                 double load_factor = 1);

/// f = negative gradient of the potential (N).
void undamped_forces(const MassSpringModel& model, const Forces& forces, const State& state,
                     Eigen::Matrix3Xd& f, double load_factor = 1);

/// Hessian of what acts on the surface (N/m).
SurfaceHessian surface_hessian(const Forces& forces, const State& state, Curvature curvature,
                               double load_factor = 1);

/// Zero matrix with the pattern of the model's stiffness.
BlockMatrix stiffness_pattern(const MassSpringModel& model);

/// K += Hessian of the elastic energy (N/m); K is symmetric.
void add_stiffness(const MassSpringModel& model, const State& state, BlockMatrix& K,
                   Curvature curvature = Curvature::Projected);

/// Stiffness of the model, or where springs are coupled of its single tetrahedra, which is sparser. Of each counts what
/// averages would leave [parts_left_by_averages].
BlockMatrix simple_stiffness(const MassSpringModel& model, const State& state);
constexpr double kLocks = 0.49;  ///< Poisson's ratio beyond which single tetrahedra are a poor guide

/// Full geometry, and springs are all that add_stiffness adds, so that no step needs the matrix.
bool is_springs_alone(const MassSpringModel& model);

/// y_i <- S_i y_i at every constrained node [(25)].
void filter(const std::vector<Constraint>& constraints, Eigen::Matrix3Xd& y);

/// A <- S A S + (I - S) d [(25)], d the largest diagonal entry:
/// the matrix on the constrained space, regular where A is on that space.
void filter(const std::vector<Constraint>& constraints, BlockMatrix& A);

/// Moves constrained nodes from rest to where they are prescribed at t, along the directions taken away only.
void prescribe(const std::vector<Constraint>& constraints, const Eigen::Matrix3Xd& rest, double t, double end,
               Eigen::Matrix3Xd& x);

}  // namespace testbed::massspring
