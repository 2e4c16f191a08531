// Elastostatics on straight tetrahedra with deal.II, at small or finite strain: the reference.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "fem_reference/elements/laws.h"
#include "fem_reference/elements/share.h"
#include "meshing/algebra/load_path.h"
#include "meshing/base/mesh.h"
#include "meshing/base/stage_timer.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::fem {

/// Loads at full load factor, on the undeformed body; an empty function is no load.
struct ElasticLoads {
  std::function<Eigen::Vector3d(const Eigen::Vector3d& x)> body_force;  ///< N/m3
  /// On boundary triangle `f` of the mesh, at x (Pa).
  std::function<Eigen::Vector3d(const Eigen::Vector3d& x, int f)> traction;
  /// Pressure (Pa) on boundary triangle `f` as it is deformed;
  /// whole components of the surface. At finite strain.
  std::function<double(int f)> follower_pressure;
  /// What else acts on the surface, of the positions of all nodes. Steps are those of the load factor.
  meshing::SurfaceEnergies surface = {};
  /// Stress-free shrinkage s(x) at a load factor, eps* = -s I:
  /// the continuum form of collapsing rest lengths [paper eq. 8].
  std::function<double(const Eigen::Vector3d& x, double load_factor)> shrinkage;
  /// Displacement (m) of the k-th constrained component at a load factor; absent: it grows with that.
  std::function<double(int k, double load_factor)> motion;
};

/// A component of a node's displacement that is prescribed, at full load factor (m).
struct ConstrainedComponent {
  int node, component;
  double displacement;
  int support = 0;  ///< of the scene, that prescribes it
};

/// The equilibrium that the next one is looked for from, and those before it.
struct ElasticState {
  Eigen::Matrix3Xd u;  ///< m
  double load_factor = 0;
  meshing::LoadPath path;  ///< at finite strain
  meshing::SurfaceMemories surface = {};
};

struct ElasticReport {
  std::string solver;
  int newton_iterations = 0;
  int linear_iterations = 0;  ///< of all linear solves
  double residual = 0;        ///< over load plus elastic forces; Newton: the largest, else the first
  double tolerance = 0;       ///< of the residual
  bool is_converged = false;
  bool is_definite = true;    ///< the tangent stiffness where Newton's iteration ended
  double elastic_energy = 0;  ///< J
  double max_strain = 0;      ///< largest |principal strain| (small strain) or |principal stretch - 1|
};

/// Smallest det F where the energy is summed and at the nodes of elements, which may be turned inside out
/// between points of the sum.
struct SmallestJacobians {
  double at_points, at_nodes;
};

/// Internal forces of a displaced body and their gradient, of all components 3 node + c, nothing constrained.
struct Linearisation {
  Eigen::VectorXd force;                ///< N, gradient of the elastic energy and of what acts on the surface
  Eigen::SparseMatrix<double> tangent;  ///< N/m
  std::vector<Eigen::VectorXd> roots;   ///< what the tangent leaves out: each adds g g^T
  double energy = 0;                    ///< elastic (J); infinite where the law has none
};

/// x of A x = r to a residual of so much of r: over all unknowns, 0 of those that are constrained. None where A is not
/// positive definite.
using StepSolver = std::function<std::optional<Eigen::VectorXd>(const Eigen::VectorXd& r, double tolerance)>;

/// Equilibrium of -div P(grad u) = f [fem_reference/README.md (1)]. Nodes:
/// the vertices of the mesh in their order, then (degree 2) the middles of its edges.
class ElasticSolid {
 public:
  /// @param share  a mesh, or of several processes this one's share: X, cells, faces, displacement and all that is over
  /// nodes is over those of the share
  /// @throws std::runtime_error when a tetrahedron has no positive volume.
  ElasticSolid(Share share, int degree);
  ~ElasticSolid();
  ElasticSolid(ElasticSolid&&) noexcept;
  ElasticSolid& operator=(ElasticSolid&&) noexcept;

  const Eigen::Matrix3Xd& X() const;  ///< 3 x n_nodes (m)
  const TetMesh& mesh() const;
  const Eigen::MatrixXi& cells() const;  ///< 4 or 10 nodes per tetrahedron, in VTK's order
  /// 3 or 6 nodes per boundary triangle: corners, middles of 01, 12, 20.
  const Eigen::MatrixXi& faces() const;
  const Share& share() const;
  int n_nodes() const;  ///< of the whole mesh, as the next
  int n_dofs() const { return 3 * n_nodes(); }

  /// Takes the problem over and assembles its loads.
  /// @param kappa  of volume.local (Pa), neo-Hookean
  void assemble(const Material& material, ElasticLaw law, const ElasticLoads& loads,
                const std::vector<ConstrainedComponent>& constrained, double kappa = 0);
  /// Adds to the load the inertia of the free rigid motions that it drives:
  /// what deforms a body that moves freely, seen from the body.
  void relieve_inertia();
  /// Shrinkage from here on where loads have none, as that in motion: at the vertices of the mesh, linear in each
  /// tetrahedron.
  void set_shrinkage(const Eigen::VectorXd& s);
  /// Residual, as in ElasticReport, at which solves stop: 1e-13 of small strain, 1e-10 of others unless set.
  void set_tolerance(double tolerance);
  /// Number of rigid motions that the constrained components leave free; they are kept out of the solution.
  int n_free_rigid_motions() const;
  /// Free ones of the body at rest: all components 3 node + c, orthonormal.
  Eigen::MatrixXd rigid_motions_at_rest() const;

  /// Equilibrium at a load factor, from the one found before (at first: from rest). Small strain:
  /// one linear solve. Finite strain, or where something acts on the surface: Newton with line search on the potential energy, in
  /// adaptive parts; where that fails, displacement stays at the last equilibrium. Linear
  /// systems by conjugate gradients in single precision [solvers/two_level.h]; residuals
  /// are in double precision.
  /// @param timer  told the stages "assemble" and "solve"
  /// @throws std::runtime_error when rigid motions are left free
  /// and the loads drive them: names the motions, force and torque.
  ElasticReport solve(double load_factor = 1, StageTimer* timer = nullptr);
  ElasticState state() const;
  /// Goes on from a state of the same problem.
  void set_state(const ElasticState& state);
  /// 3 x n_nodes (m); orthogonal in L2 to the rigid motions that are free.
  const Eigen::Matrix3Xd& displacement() const;

  /// Largest strain of a displacement (3 x n_nodes), as in ElasticReport.
  double max_strain(const Eigen::Matrix3Xd& displacement) const;
  SmallestJacobians smallest_jacobians(const Eigen::Matrix3Xd& displacement) const;

  /// Of a displacement (3 x n_nodes) at a load factor; without its tangent where that is not wanted.
  Linearisation linearise(const Eigen::Matrix3Xd& displacement, double load_factor = 1,
                          bool with_tangent = true) const;
  /// Elastic energy and that of what acts on the surface (J).
  double energy(const Eigen::Ref<const Eigen::Matrix3Xd>& displacement, double load_factor = 1) const;
  /// The force alone, 3 x n_nodes.
  void find_forces(const Eigen::Ref<const Eigen::Matrix3Xd>& displacement, double load_factor,
                   Eigen::Matrix3Xd& force) const;
  /// Stiffness at rest without contact (N/m), mass (kg) and full load (N) of all components 3 node + c, nothing
  /// constrained. Rows that other processes own are 0, as are their parts of forces.
  /// @param roots  becomes columns of what the stiffness leaves out, roots roots^T; null: not wanted
  Eigen::SparseMatrix<double> stiffness(Eigen::MatrixXd* roots = nullptr) const;
  /// Lumped: an element's mass in the proportions of its diagonal [Hinton, Rock & Zienkiewicz 1976].
  Eigen::SparseMatrix<double> mass(MassMatrix kind = MassMatrix::Consistent) const;
  Eigen::VectorXd load() const;
  /// Of the matrix `mass` M + `stiffness` K, K the tangent at a displacement under full loads, by the iterations of
  /// statics [solvers/two_level.h]. It refers to this solid. Without mass free rigid motions are kept out.
  StepSolver step_solver(const Eigen::SparseMatrix<double>& M, double mass,
                         const Eigen::Matrix3Xd& displacement, double stiffness,
                         const std::vector<int>& constrained) const;
  const meshing::SurfaceEnergies& surface() const;
  const std::vector<ConstrainedComponent>& constrained() const;
  /// Displacement (m) of the k-th constrained component at a load factor.
  double constrained_displacement(int k, double load_factor) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> self_;
};

}  // namespace testbed::fem
