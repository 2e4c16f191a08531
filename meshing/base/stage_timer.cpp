#include "meshing/base/stage_timer.h"

namespace testbed::meshing {

void StageTimer::start(const std::string& stage) {
  stop();
  current_ = stage;
  since_ = Clock::now();
}

void StageTimer::stop() {
  if (current_.empty()) return;
  const double seconds = std::chrono::duration<double>(Clock::now() - since_).count();
  for (auto& [name, total] : stages_)
    if (name == current_) {
      total += seconds;
      current_.clear();
      return;
    }
  stages_.emplace_back(current_, seconds);
  current_.clear();
}

}  // namespace testbed::meshing
