// The equations of motion of a solid with all that acts on it, without damping, for tests of schemes.
#pragma once

#include "fem_reference/solid/dynamics.h"

namespace testbed::fem {

/// @param solid  assembled; to outlive what is returned
inline Dynamics dynamics_of(ElasticSolid& solid) {
  const Eigen::Index n = solid.X().cols();
  Dynamics s{solid.stiffness(), solid.mass(), 0, 0, Eigen::VectorXd::Zero(solid.n_dofs()), {}, {}, {}};
  s.linearise = [&solid, n](const Eigen::VectorXd& u, bool with_tangent) {
    return solid.linearise(u.reshaped(3, n), 1, with_tangent);
  };
  s.potential = [&solid, n](const Eigen::VectorXd& u) { return solid.energy(u.reshaped(3, n)); };
  s.X = solid.X();
  s.surface = solid.surface();
  return s;
}

/// kg m/s along axis c.
inline double momentum_of(const Dynamics& s, const Eigen::VectorXd& v, int c) {
  const Eigen::VectorXd p = s.M * v;
  return Eigen::VectorXd(p(Eigen::seq(c, Eigen::last, 3))).sum();
}

}  // namespace testbed::fem
