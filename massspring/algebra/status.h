#pragma once

namespace testbed::massspring {

/// How a step or an iteration ended. Divergence is data, not an exception.
enum class Status { Ok, NotConverged, Diverged };

}  // namespace testbed::massspring
