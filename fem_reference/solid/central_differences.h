// Explicit steps in time of the reference, on masses lumped at nodes.
#pragma once

#include "fem_reference/solid/dynamics.h"

namespace testbed::fem {

/// Central differences [Newmark 1959] with beta = 0 and gamma = 1/2 [(7)]. No system of equations is solved,
/// and angular momentum is kept at finite strain; steps beyond stable_step() grow without bound.
class CentralDifferences : public Integrator {
 public:
  /// @param system  M diagonal and positive where this process owns, no stiffness damping
  CentralDifferences(Dynamics system, double h);

  bool step() override;
  std::string solver() const override;

 private:
  void find_free() override;
  void go_on(const Eigen::VectorXd& u, const Eigen::VectorXd& v) override;
  void accelerate(double time);

  Eigen::VectorXd inverse_mass_;  // 0 of constrained unknowns and those of others
  Eigen::Matrix3Xd force_;
};

/// Longest stable step of central differences for small motions about rest (s): 2 over the highest frequency
/// of K against M, which is diagonal [Courant, Friedrichs & Lewy 1928].
double stable_step(const Dynamics& system);

}  // namespace testbed::fem
