// Springs between the surface and points that move, as hands pull it.
#pragma once

#include "meshing/scene/surface_problem.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Energy (J) k/(2 m) sum |x_i - (X_i + u(t))|^2 over the m vertices of a handle of stiffness k (N/m), u(t) its motion (m).
class HandleSprings : public SurfaceEnergy {
 public:
  /// Until the first step it is as at t (s), or at its start, so that what asks for its stiffness finds it.
  /// @param X      nodes at rest (3 x n, m), the surface's vertices first
  /// @param frame  axes of X, in columns
  HandleSprings(const SurfaceProblem::Held& held, const Eigen::Matrix3Xd& X, const Eigen::Matrix3d& frame,
                double t);

  const char* name() const override { return "handle"; }
  /// Each step has the other end where it is at the step's end.
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  double energy(const Eigen::Matrix3Xd& x) const override;
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;
  bool is_invariant() const override { return false; }

 private:
  void place(double t);

  SurfaceProblem::Held held_;
  Eigen::Matrix3Xd rest_;  // of the vertices (m)
  Eigen::Matrix3d frame_;
  Eigen::Vector3d shift_{0, 0, 0};  // m
  double stiffness_ = 0;            // N/m, of each vertex; 0: it has let go
};

/// One for each handle.
SurfaceEnergies handles_of(const SurfaceProblem& problem, const Eigen::Matrix3Xd& X,
                           const Eigen::Matrix3d& frame = Eigen::Matrix3d::Identity(), double t = 0);

}  // namespace testbed::meshing
