// A limit of wall-clock time.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Tells when a time is over and, where nobody asks for too long, acts by itself.
class Budget {
 public:
  /// @param seconds  absent: without bound
  /// @param overdue  is called in a thread of its own a tenth of the budget later, and at least a second
  Budget(std::optional<double> seconds, std::function<void()> overdue);
  ~Budget();
  Budget(const Budget&) = delete;

  bool is_spent() const;

 private:
  using Clock = std::chrono::steady_clock;
  std::optional<Clock::time_point> end_;
  std::mutex mutex_;
  std::condition_variable condition_;
  bool has_ended_ = false;
  std::thread watch_;
};

}  // namespace testbed::meshing
