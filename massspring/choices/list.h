// Everything that a scene can choose from.
#pragma once

#include <nlohmann/json.hpp>

namespace testbed::massspring {

/// The tables of spring models and integrators, row by row, and every key of a scene with its default and
/// meaning; a key that has no default has null.
nlohmann::ordered_json list_choices();

}  // namespace testbed::massspring
