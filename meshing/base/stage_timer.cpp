#include "meshing/base/stage_timer.h"

namespace testbed::meshing {

void StageTimer::start(const std::string& stage) {
  stop();
  current_ = stage;
  since_ = Clock::now();
}

void StageTimer::stop() {
  if (current_.empty()) return;
  add(current_, std::chrono::duration<double>(Clock::now() - since_).count());
  current_.clear();
}

void StageTimer::add(const std::string& stage, double seconds) {
  for (auto& [name, total] : stages_)
    if (name == stage) {
      total += seconds;
      return;
    }
  stages_.emplace_back(stage, seconds);
}

}  // namespace testbed::meshing
