// The stability map: every start, stiffness, step and method; a row per cell on stdout (CSV). Fails where a
// cell of ours diverges or gains energy. stability N leaves out the first N cells, which a killed run has
// written. stability N SEED draws other starts by this seed, for the coupled springs alone.
#include <cstdio>
#include <cstdlib>

#include "tests/stability/stability.h"

int main(int argc, char** argv) {
  using namespace testbed;
  using namespace testbed::massspring;
  bool is_ok = true;
  int n_known = argc > 1 ? std::atoi(argv[1]) : 0;
  const bool has_seed = argc > 2;
  const std::uint64_t seed = has_seed ? std::strtoull(argv[2], nullptr, 10) : kSeed;
  if (n_known == 0) std::puts("method,is_papers,start,E,h,outcome,t,energy_ratio,least_patch");
  for (const Method& method : methods()) {
    if (has_seed && !find_calibration(method.calibration).is_coupled) continue;
    for (const Start& start : starts())
      for (double E : {1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9})
        for (double h : {1e-4, 1e-3, 1e-2, 1e-1, 1.}) {
          if (n_known-- > 0) continue;
          const Outcome outcome = run_cell(method, start, E, h, seed);
          std::printf("%s,%d,%s,%g,%g,%s,%.9g,%.9g,%.9g\n", method.name.c_str(), method.is_papers,
                      start.name.c_str(), E, h, outcome.name.c_str(), outcome.t, outcome.energy_ratio,
                      outcome.least_patch);
          std::fflush(stdout);
          if (!method.is_papers && (outcome.name == "diverged" || outcome.name == "energy_gained"))
            is_ok = false;
        }
  }
  return is_ok ? 0 : 1;
}
