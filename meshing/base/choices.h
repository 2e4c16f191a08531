// What a scene chooses by name.
#pragma once

#include "meshing/base/namespace.h"

namespace testbed::meshing {

enum class TimeMode { Static, Dynamic };
enum class Integrator {
  ExplicitEuler,
  SymplecticEuler,
  Rk4,
  ImplicitEuler,
  MinimisingEuler,
  Midpoint,
  Bdf2,
  TrBdf2
};
/// Method for the linear systems of the linearised implicit step.
enum class Krylov { Cg, BiCgStab };
/// Tension of an independent spring compressed below its rest length r; above it both are
/// Hooke's [massspring/README.md (3) to (6)].
enum class SpringLaw {
  Hooke,    ///< k_s (l - r): a network of such springs loses ellipticity at 20 % hydrostatic compression
  Definite  ///< k_s r/4 (1 - (r/l)^4): the same stiffness at rest, without bound as l -> 0
};

enum class MassMatrix { Consistent, Lumped };

/// SmallStrain is a fair reference below a few per cent of strain; NeoHookean is the law of coupled springs.
enum class ElasticLaw { SmallStrain, StVenantKirchhoff, NeoHookean };

}  // namespace testbed::meshing
