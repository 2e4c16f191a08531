// Elastic laws: energy density, first Piola-Kirchhoff stress and tangent at a deformation gradient.
#pragma once

#include <Eigen/Core>

#include "meshing/scene/scene.h"

namespace testbed::fem {

/// Saint Venant's and Kirchhoff's is no choice of a scene: another program confirms finite strain by it.
enum class ElasticLaw { SmallStrain, StVenantKirchhoff, NeoHookean };

struct LameConstants {
  double lambda, mu;  ///< Pa
  explicit LameConstants(const Material& material);
};

/// Per volume at rest; F and P by columns as vectors of 9.
struct ElasticResponse {
  double energy;                  ///< J/m3; infinite where the law has none (det F <= 0)
  Eigen::Matrix3d P;              ///< dW/dF (Pa)
  Eigen::Matrix<double, 9, 9> C;  ///< dP/dF (Pa)
};

/// Response of a law at F [fem_reference/README.md]. The stress-free state has shrunk by the fraction s
/// in every direction: an eigenstrain -s I, or F = F_elastic (1 - s) at finite strain.
///   small_strain         lambda/2 tr(eps)^2 + mu eps : eps, eps = sym F - I + s I        [(2)]
///   st_venant_kirchhoff  the same in E = (F^T F - I)/2                                 [(3)]
///   neo_hookean          mu/2 (|F|^2 - 3) + lambda/4 (J^2 - 1) - (mu + lambda/2) ln J    [(4)]
/// @param with_tangent  false: C is left unset
ElasticResponse respond(ElasticLaw law, const LameConstants& lame, const Eigen::Matrix3d& F, double s,
                        bool with_tangent = true);

}  // namespace testbed::fem
