// What the elastic solid is made of. Internal to the library: it brings deal.II's headers.
#pragma once

#include <optional>
#include <vector>

#include "fem_reference/elements/space.h"
#include "fem_reference/elements/tet_batches.h"
#include "fem_reference/solid/elasticity.h"
#include "fem_reference/solvers/two_level.h"
#include "meshing/algebra/load_path.h"
#include "meshing/algebra/newton.h"
#include "meshing/surface_energies/surface_points.h"

namespace testbed::fem {

struct ElasticSolid::Implementation {
  using Matrix3Xd = Eigen::Matrix3Xd;

  Implementation(Share part, int p);

  Share share;
  const TetMesh& mesh = share.mesh;
  int degree;
  Nodes nodes;
  dealii::Triangulation<3> triangulation;
  dealii::MappingFE<3> mapping{dealii::FE_SimplexP<3>(1)};
  Space space;
  TetBatches tets;
  std::optional<TetBatches> corners;  // of degree 1, on degree 2
  TwoLevelSolver solver;
  meshing::SurfacePoints from_corners;  // all nodes as points of the corners

  Material material;
  LameConstants lame{material};
  ElasticLaw law = ElasticLaw::SmallStrain;
  std::optional<double> tolerance;
  ElasticLoads loads;
  meshing::SurfaceEnergies surface;  // what acts on the surface
  std::optional<double> stepped_to;  // load factor of the step at hand of the surface
  std::vector<ConstrainedComponent> constrained;
  std::vector<char> is_constrained;                             // 3 node + component
  std::vector<char> constrained_rows, constrained_corner_rows;  // of the matrices
  Eigen::VectorXd load;   // N at full load, of component c of node i at 3 i + c
  Eigen::MatrixXd rigid;  // free rigid motions of the body as deformed, 3 node + component, orthonormal

  Matrix3Xd u;
  double factor = 0;  // load factor of u
  std::optional<meshing::LoadPath> path;
  std::optional<TwoLevelSolver::Stiffness> constant;  // the stiffness of small strain, once it is needed
  Eigen::VectorXd row_sums;                           // of `constant`, per node (N/m)
  double shrunk_at = -1;                              // load factor of the shrinkage in use
  double size = 0;                                    // largest load plus elastic forces met in a solve (N)
  ElasticReport report;                               // of the solve at hand

  void find_rigid_motions(const Matrix3Xd& at);
  void check_balance() const;
  double constrained_displacement(int k, double load_factor) const;
  void prescribe(double load_factor, Matrix3Xd& at) const;
  void find_load();
  void shrink(double load_factor);

  /// Forces out of balance on what is free.
  void find_residual(const Matrix3Xd& at, double load_factor, Matrix3Xd& r);
  double potential(const Matrix3Xd& at, double load_factor);  // in all processes
  double energy(const Matrix3Xd& at, double load_factor);     // without dead loads, this process' part
  const meshing::SurfaceEnergies& surface_at(double load_factor) const;
  /// A load step to `load_factor` begins from the last equilibrium.
  void begin_step(double load_factor);
  void keep_out(Matrix3Xd& x) const;
  /// Whether forces of this size out of balance are none.
  bool is_balanced(const Matrix3Xd& at, double residual);
  Eigen::VectorXd row_sums_of(const TwoLevelSolver::Stiffness& A) const;
  double norm_beyond_rounding(const Matrix3Xd& at, const Matrix3Xd& r) const;
  /// The tangent, nothing constrained; blocks are zero. Projected: that of the surface alone. What the pattern has no
  /// place for is returned, over ranks.
  template <class Real>
  meshing::SurfaceHessian fill(const TetBatches& on, const Matrix3Xd& at, double load_factor,
                               meshing::Curvature curvature, Real* blocks) const;
  /// The same with its factories, nothing constrained in its own blocks.
  TwoLevelSolver::Stiffness stiffness_at(const Matrix3Xd& at, double load_factor,
                                         meshing::Curvature curvature) const;
  void hold(TwoLevelSolver::Stiffness& A) const;
  /// Over nodes, nothing constrained.
  void find_tangent(const Matrix3Xd& at, double load_factor, meshing::Curvature curvature,
                    Linearisation& result) const;

  void drop_ghosts(Eigen::SparseMatrix<double>& A) const;
  void remove_rigid(Matrix3Xd& forces) const;  // what drives free rigid motions

  void solve_linear(double load_factor, StageTimer* timer);
  void iterate_in_double(const Matrix3Xd& r, double tolerance, Matrix3Xd& x);
  void balance_rigid_motions(const TwoLevelSolver::Stiffness& A, const Matrix3Xd& at, const Matrix3Xd& r,
                             Matrix3Xd& dx) const;
  bool solve_direction(const Matrix3Xd& at, double load_factor, const Matrix3Xd& r, double tolerance,
                       Matrix3Xd& dx);
  void follow_supports(double load_factor, Matrix3Xd& x);
  bool balance(double load_factor, Matrix3Xd& x, StageTimer* timer);

  void remove_rigid_motion(Matrix3Xd& displacement) const;
  double max_strain(const Matrix3Xd& at) const;
  double least_jacobian(const Matrix3Xd& at, const Eigen::Matrix4Xd& points) const;
  TetRule rule(int p) const;
};

}  // namespace testbed::fem
