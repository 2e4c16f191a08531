// What of a scene may change while its run goes on.
#pragma once

#include <set>
#include <string>

#include "meshing/scene/scene.h"

namespace testbed::meshing {

/// Keys of two scenes whose values differ, each once, but for events. A run of the first may go on under the second.
/// @throws std::runtime_error naming a key that asks for a new run, or the law that the scenes imply
std::set<std::string> changed_keys(const Scene& before, const Scene& after);

/// Whether a key lies in a table, or in one of a list of tables.
bool is_of(const std::string& key, const std::string& table);

/// Steps of a run in time: those done until t (s), and as many of a length (s) as lead from there to time.end.
/// @throws std::runtime_error as n_steps
int n_steps_from(const TimeOptions& time, double step, double t, int n_done);

}  // namespace testbed::meshing
