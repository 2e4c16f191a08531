// The PCP paper's method as a choice of keys.
#pragma once

#include "meshing/scene/scene.h"

namespace testbed::massspring {

/// Sets what the paper prescribes, whatever the scene says: its network, springs, steps, solver and collapse. Any
/// scheme but explicit Euler's becomes its implicit one.
void set_paper_method(Scene& scene);

}  // namespace testbed::massspring
