// Words for messages about names that are not known.
#pragma once

#include <string>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// "a, b, c".
std::string joined(const std::vector<std::string>& words);

/// ", did you mean X? (known: a, b, c)", the question only where a known name is near.
std::string suggestion(const std::string& name, const std::vector<std::string>& known);

}  // namespace testbed::meshing
