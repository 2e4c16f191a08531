#include <gtest/gtest.h>

#include <algorithm>

#include "meshing/progress.h"

namespace testbed {
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

}  // namespace
}  // namespace testbed
