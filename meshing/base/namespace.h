// Both solvers stand on meshing: its names are theirs.
#pragma once

namespace testbed {
namespace meshing {}
using namespace meshing;
}  // namespace testbed
