#include "massspring/choices/paper.h"

namespace testbed::massspring {

void set_paper_method(Scene& scene) {
  scene.network.sampling = name_of(Sampling::Darts);
  scene.network.connectivity = name_of(Connectivity::Pcp);
  scene.network.calibration = "uniform";
  scene.network.link_share = 0;
  scene.network.spring_law = SpringLaw::Hooke;
  if (scene.time.integrator != "explicit_euler") {
    scene.time.integrator = "implicit_euler";
    scene.time.linear_solver = Krylov::BiCg;
  }
  scene.time.tolerance = scene.time.sleep_below = 0;
  if (scene.collapse) {
    scene.collapse->is_per_step = true;
    scene.collapse->least = 0;
  }
  scene.comparison.calibrations.clear();
  for (Event& event : scene.events) {
    Scene after = *event.after;
    set_paper_method(after);
    event.after = std::make_shared<const Scene>(std::move(after));
  }
}

}  // namespace testbed::massspring
