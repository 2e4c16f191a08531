// What the stages of a run take.
#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Seconds of the named stages of a run, in the order in which they first ran.
class StageTimer {
 public:
  void start(const std::string& stage);  ///< ends the stage before it
  void stop();
  void add(const std::string& stage, double seconds);  ///< that were measured otherwise
  const std::vector<std::pair<std::string, double>>& seconds() const { return stages_; }

 private:
  using Clock = std::chrono::steady_clock;
  std::vector<std::pair<std::string, double>> stages_;
  std::string current_;
  Clock::time_point since_;
};

}  // namespace testbed::meshing
