#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#include "fem_reference/base/memory.h"

namespace testbed::fem {
namespace {

std::string refusal(std::int64_t n_tetrahedra, int refine, int degree, Memory kind, double available) {
  try {
    check_memory(n_tetrahedra, refine, degree, kind, available);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(CheckMemory, NamesWhatFits) {
  constexpr double k4GiB = 4. * 1024 * 1024 * 1024;
  EXPECT_EQ(refusal(50000, 1, 2, Memory::Iterations, k4GiB), "");
  EXPECT_EQ(
      refusal(50000, 2, 2, Memory::Iterations, k4GiB),
      "reference.degree = 2, reference.refine = 2: 3.2e+06 tetrahedra need about 18 GiB, 4 GiB are free; "
      "expected refine <= 1");
  const std::string factor = refusal(100000, 0, 2, Memory::Factor, k4GiB);
  EXPECT_NE(factor.find("at most 4.1e+04 tetrahedra"), std::string::npos) << factor;
}

TEST(CheckMemory, AdvisesLinearElementsWhereTheyAreNotYet) {
  const std::string advice = " tetrahedra (a coarser surface, a larger reference.interior_size";
  for (const auto& [degree, end] : {std::pair(1, advice + ")"), {2, advice + ", degree 1)"}}) {
    const std::string what = refusal(100000, 0, degree, Memory::Factor, 0.3e9);
    ASSERT_GE(what.size(), end.size()) << what;
    EXPECT_EQ(what.substr(what.size() - end.size()), end);
  }
}

// Measured with time.mode = "static" and "dynamic" on ball_pressure.toml (analysis/RESULTS.md, 9).
TEST(MemoryNeeded, IsThatMeasured) {
  struct Run {
    double n_tetrahedra;
    int degree;
    Memory kind;
    double mebibyte;
  };
  for (const Run& run : {Run{3675328, 1, Memory::Iterations, 5414}, Run{459416, 2, Memory::Iterations, 2372},
                         Run{39084, 2, Memory::Factor, 3339}, Run{16464, 2, Memory::Factor, 1374},
                         Run{87959, 1, Memory::Factor, 661}, Run{20224, 2, Memory::FactorAndCopy, 2160}}) {
    const double over = memory_needed(run.n_tetrahedra, run.degree, run.kind) / (run.mebibyte * 1024 * 1024);
    EXPECT_GT(over, 0.95);
    EXPECT_LT(over, 1.35);
  }
}

// Measured on bar_sag.toml with surface.n_vertices = 6000 and mpirun -np 4.
TEST(MemoryNeeded, CountsEveryProcess) {
  const Processes four{4, 0, 1, 4}, on_two_machines{4, 0, 1, 2};
  const double of_four = memory_needed(70815, 2, Memory::Iterations, four);
  const double over = of_four / (350.5e6 + 298.6e6 + 298.5e6 + 292.8e6);
  EXPECT_GT(over, 0.95);
  EXPECT_LT(over, 1.35);
  EXPECT_LT(memory_needed(70815, 2, Memory::Iterations, on_two_machines), 0.6 * of_four);
}

TEST(MemoryAvailable, IsThatOfAMachine) {
  EXPECT_GT(memory_available(), 1e7);
  EXPECT_LT(memory_available(), 1e14);
}

TEST(MemoryAvailable, HasWhatCachesGiveBack) {
  std::ifstream limit("/sys/fs/cgroup/memory.max"), file("/proc/meminfo");
  if (std::string word; limit >> word && word != "max") GTEST_SKIP() << "a group's limit counts";
  std::map<std::string, double> kibibytes;
  for (std::string line; std::getline(file, line);)
    kibibytes[line.substr(0, line.find(':'))] = std::stod(line.substr(line.find(':') + 1));
  const double given_back = kibibytes.at("MemAvailable") - kibibytes.at("MemFree");
  if (given_back < 0.1 * kibibytes.at("MemFree")) GTEST_SKIP() << "caches hold next to nothing";
  EXPECT_NEAR(memory_available() / 1024, kibibytes.at("MemAvailable"), given_back / 2);
}

}  // namespace
}  // namespace testbed::fem
