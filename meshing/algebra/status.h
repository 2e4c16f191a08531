// How a step or an iteration ends.
#pragma once

#include "meshing/base/choices.h"
#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Divergence is data, not an exception.
enum class Status { Ok, NotConverged, StrainTooLarge, EnergyGained, Diverged };
constexpr std::array<Named<Status>, 5> names_of(Status) {
  return {{{Status::Ok, "ok"},
           {Status::NotConverged, "not_converged"},
           {Status::StrainTooLarge, "strain_too_large"},
           {Status::EnergyGained, "energy_gained"},
           {Status::Diverged, "diverged"}}};
}

}  // namespace testbed::meshing
