// Progress of long stages, for people.
#pragma once

#include <chrono>
#include <string>

namespace testbed::meshing {

/// "7 s", "4 min", "2 h": of seconds that are foreseen.
std::string duration(double seconds);

/// Writes to stderr: on a terminal a line with a time estimate, elsewhere a plain line as a stage begins
/// and ends, and every few seconds between.
class Progress {
 public:
  explicit Progress(bool is_quiet);
  ~Progress();
  void stage(const std::string& name);  ///< begins a stage, ends the one before it
  void update(double fraction);         ///< of the current stage, in [0, 1]
  void tell(const std::string& text);   ///< a line of its own

 private:
  void end_stage();

  using Clock = std::chrono::steady_clock;
  bool is_quiet_, is_terminal_;
  std::string name_;
  Clock::time_point since_, shown_;
};

}  // namespace testbed::meshing
