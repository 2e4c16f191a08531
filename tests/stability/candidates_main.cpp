// What candidates for the law of coupled springs make of crushed and random bodies, four seeds each; a row per cell
// on stdout (CSV). bend_error is that of the candidate in a bent cube at small strain; squash_error what it changes of
// the stress on volume at det F = 1/2. stability_candidates N leaves out the first N cells.
#include <cstdio>
#include <cstdlib>

#include "massspring/energies/tractions.h"
#include "massspring/statics/exact_fields.h"
#include "massspring/statics/linear_statics.h"
#include "tests/stability/candidates.h"

namespace testbed::massspring {
namespace {

double bend_error(const Method& method, const Candidate& candidate) {
  MassSpringModel model = make_body(method, 1);
  Forces forces;
  change_of(candidate)(model, forces);
  const Eigen::Matrix3Xd& X = model.network.X;
  const ExactField field = exact_field("bending", lame_of(model.material), X.rowwise().mean());
  Eigen::Matrix3Xd u;
  LinearStatics(model, hold_rigid_motion(X))
      .solve(traction_forces(field.stress, X, model.network.F), u, 1e-10);
  return surface_error(u, displacements(field, X), X, model.network.F).l2;
}

double squash_error(const Candidate& candidate) {
  if (!candidate.of_patches) return 0;
  constexpr double kJ = 0.5;
  return std::abs(candidate.of_patches(kJ, 1, 1).first / (expanded(kJ, 1, 1, kLeastJacobian).first + 1));
}

}  // namespace
}  // namespace testbed::massspring

int main(int argc, char** argv) {
  using namespace testbed::massspring;
  int n_known = argc > 1 ? std::atoi(argv[1]) : 0;
  if (n_known == 0)
    std::puts("candidate,method,start,E,h,seed,outcome,newton_iterations,bend_error,squash_error");
  for (const Candidate& candidate : candidates())
    for (const Method& method : methods()) {
      if (!find_calibration(method.calibration).is_coupled) continue;
      const double bend = bend_error(method, candidate), squash = squash_error(candidate);
      for (const Start& start : starts()) {
        if (start.name != "crushed" && start.name != "random") continue;
        for (const int seed : {1, 2, 3, 4})
          for (const auto& [E, h] :
               {std::pair{1e5, 1e-2}, {1e6, 1e-2}, {1e6, 0.1}, {1e5, 1.}, {1e8, 0.1}, {1e8, 1.}}) {
            if (n_known-- > 0) continue;
            const Outcome outcome = run_cell(method, start, E, h, seed, change_of(candidate));
            std::printf("\"%s\",%s,%s,%g,%g,%d,%s,%d,%.6g,%.6g\n", candidate.name.c_str(),
                        method.name.c_str(), start.name.c_str(), E, h, seed, outcome.name.c_str(),
                        outcome.newton_iterations, bend, squash);
            std::fflush(stdout);
          }
      }
    }
}
