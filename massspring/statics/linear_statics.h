// Small displacements from rest under small loads.
#pragma once

#include <Eigen/Core>
#include <variant>
#include <vector>

#include "massspring/model/model.h"
#include "meshing/algebra/cholesky.h"
#include "meshing/algebra/conjugate_gradients.h"
#include "meshing/algebra/multigrid.h"

namespace testbed::massspring {

/// Six components of three nodes far apart: just enough to hold a free body under balanced loads, without
/// force.
std::vector<Constraint> hold_rigid_motion(const Eigen::Matrix3Xd& X);

/// K u = f for the model's stiffness K at rest, by conjugate gradients. Where coupled springs alone make up the
/// model they are preconditioned by single tetrahedra (K has four times as many entries): by their Cholesky factor, on
/// many nodes by multigrid. Where there are independent springs by a factor of K itself.
class LinearStatics {
 public:
  /// Constrained directions stay at rest.
  /// @throws std::runtime_error when a factor finds K not positive definite: too few directions are constrained, or the
  /// network is floppy.
  LinearStatics(const MassSpringModel& model, const std::vector<Constraint>& constraints);

  /// Displacement u (m) under the loads f (N), both 3 x n.
  SolveReport solve(const Eigen::Matrix3Xd& f, Eigen::Matrix3Xd& u, double tolerance = 1e-8);

 private:
  std::vector<Constraint> constraints_;
  BlockMatrix K_;
  std::variant<BlockCholesky, Multigrid> preconditioner_;
};

}  // namespace testbed::massspring
