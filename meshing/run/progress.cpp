#include "meshing/run/progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace testbed::meshing {
namespace {

double seconds(std::chrono::steady_clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

const char* const kClearLine = "\r\033[K";

}  // namespace

std::string duration(double seconds) {
  constexpr double kMinute = 60, kHour = 3600;
  char text[32];
  if (seconds < 100) {
    const double digit = seconds < 10 ? 1 : 10;
    std::snprintf(text, sizeof text, "%.0f s", std::max(1., std::round(seconds / digit) * digit));
  } else if (seconds < 100 * kMinute) {
    std::snprintf(text, sizeof text, "%.0f min", seconds / kMinute);
  } else {
    std::snprintf(text, sizeof text, "%.0f h", seconds / kHour);
  }
  return text;
}

Progress::Progress(bool is_quiet) : is_quiet_(is_quiet), is_terminal_(isatty(STDERR_FILENO)) {}

Progress::~Progress() {
  end_stage();
}

void Progress::end_stage() {
  if (is_quiet_ || name_.empty()) return;
  if (is_terminal_)
    std::fputs(kClearLine, stderr);
  else
    std::fprintf(stderr, "%s: %.1f s\n", name_.c_str(), seconds(Clock::now() - since_));
}

void Progress::stage(const std::string& name) {
  end_stage();
  name_ = name;
  since_ = shown_ = Clock::now();
  if (is_quiet_) return;
  if (is_terminal_)
    std::fprintf(stderr, "%s%s ...", kClearLine, name.c_str());
  else
    std::fprintf(stderr, "%s ...\n", name.c_str());
}

void Progress::tell(const std::string& text) {
  if (!is_quiet_) std::fprintf(stderr, "%s%s\n", is_terminal_ ? kClearLine : "", text.c_str());
}

void Progress::update(double fraction) {
  constexpr double kTerminalPause = 0.2, kPlainPause = 5;
  const auto now = Clock::now();
  if (is_quiet_ || fraction <= 0 || fraction >= 1 ||
      seconds(now - shown_) < (is_terminal_ ? kTerminalPause : kPlainPause))
    return;
  shown_ = now;
  const double left = seconds(now - since_) * (1 - fraction) / fraction;
  std::fprintf(stderr, "%s%s %.0f %%, %.0f s left%s", is_terminal_ ? kClearLine : "", name_.c_str(),
               100 * fraction, left, is_terminal_ ? "" : "\n");
}

}  // namespace testbed::meshing
