#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "meshing/run/progress.h"

namespace testbed::meshing {
namespace {

std::string output_of(bool is_quiet) {
  testing::internal::CaptureStderr();  // a file, not a terminal
  {
    Progress progress(is_quiet);
    progress.stage("mesh");
    progress.update(0.5);
    progress.stage("solve");
  }
  return testing::internal::GetCapturedStderr();
}

TEST(Progress, IsPlainLinesAtBeginAndEndOfStagesAwayFromATerminal) {
  const std::string text = output_of(false);
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 4) << text;
  EXPECT_EQ(text.find_first_of("\r\033"), std::string::npos);
  EXPECT_EQ(text.rfind("mesh ...\nmesh: ", 0), 0u) << text;
  EXPECT_NE(text.find(" s\nsolve ...\nsolve: "), std::string::npos) << text;
}

TEST(Progress, SaysNothingWhenQuiet) {
  EXPECT_EQ(output_of(true), "");
}

/// The terminal's end of a pair that stands for it, and what is written to stderr until read() is called.
class Terminal {
 public:
  Terminal() : master_(posix_openpt(O_RDWR | O_NOCTTY)), stderr_(dup(STDERR_FILENO)) {
    if (master_ < 0 || grantpt(master_) != 0 || unlockpt(master_) != 0) return;
    const int slave = open(ptsname(master_), O_RDWR | O_NOCTTY);
    is_open_ = slave >= 0 && dup2(slave, STDERR_FILENO) >= 0;
    if (slave >= 0) close(slave);
  }
  ~Terminal() {
    dup2(stderr_, STDERR_FILENO);
    close(stderr_);
    if (master_ >= 0) close(master_);
  }
  bool is_open() const { return is_open_; }

  /// What was written since; a little, at once.
  std::string read() const {
    char bytes[1024];
    const ssize_t n = ::read(master_, bytes, sizeof bytes);
    return {bytes, static_cast<size_t>(n < 0 ? 0 : n)};
  }

 private:
  int master_, stderr_;
  bool is_open_ = false;
};

TEST(Progress, TellsAPlaceInPerCentAndTheSecondsLeftOnATerminal) {
  using Clock = std::chrono::steady_clock;
  const auto since = [](Clock::time_point t) {
    return std::chrono::duration<double>(Clock::now() - t).count();
  };
  constexpr double kPart = 0.01;  // 99 times as long is left as went by
  double least, most;
  std::string text;
  {
    const Terminal terminal;
    if (!terminal.is_open()) GTEST_SKIP() << "no pseudo terminal";
    Progress progress(false);
    const auto before = Clock::now();
    progress.stage("mesh");
    const auto after = Clock::now();
    EXPECT_NE(terminal.read().find("mesh ..."), std::string::npos);
    std::this_thread::sleep_for(std::chrono::milliseconds(250));  // more than the pause between two lines
    least = since(after) * (1 - kPart) / kPart;
    progress.update(kPart);
    most = since(before) * (1 - kPart) / kPart;
    text = terminal.read();
  }
  double per_cent, left;
  ASSERT_EQ(std::sscanf(text.c_str(), "\r\033[Kmesh %lf %%, %lf s left", &per_cent, &left), 2) << text;
  EXPECT_EQ(per_cent, 1);
  EXPECT_GE(left, least - 0.5) << "rounded to whole seconds";
  EXPECT_LE(left, most + 0.5);
}

}  // namespace
}  // namespace testbed::meshing
