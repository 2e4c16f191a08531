#include "meshing/run/budget.h"

#include <algorithm>

namespace testbed::meshing {

Budget::Budget(std::optional<double> seconds, std::function<void()> overdue) {
  if (!seconds) return;
  constexpr double kPatience = 0.1, kLeastPatience = 1;  // of the budget; s
  using Seconds = std::chrono::duration<double>;
  const auto after = [start = Clock::now()](double s) {
    return start + std::chrono::duration_cast<Clock::duration>(Seconds(s));
  };
  end_ = after(*seconds);
  watch_ = std::thread([this, overdue = std::move(overdue),
                        last = after(*seconds + std::max(kLeastPatience, kPatience * *seconds))] {
    std::unique_lock lock(mutex_);
    if (condition_.wait_until(lock, last, [this] { return has_ended_; })) return;
    lock.unlock();
    overdue();
  });
}

Budget::~Budget() {
  {
    const std::scoped_lock lock(mutex_);
    has_ended_ = true;
  }
  condition_.notify_all();
  if (watch_.joinable()) watch_.join();
}

bool Budget::is_spent() const {
  return end_ && Clock::now() >= *end_;
}

}  // namespace testbed::meshing
