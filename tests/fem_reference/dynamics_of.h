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

/// Of a box whose faces x, y, z = 0 roll in their planes, so that its six rigid motions are held.
inline std::vector<ConstrainedComponent> rollers(const Eigen::Matrix3Xd& X) {
  std::vector<ConstrainedComponent> constrained;
  for (int i = 0; i < X.cols(); ++i)
    for (int c = 0; c < 3; ++c)
      if (X(c, i) == 0) constrained.push_back({i, c, 0});
  return constrained;
}

}  // namespace testbed::fem
