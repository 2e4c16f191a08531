// A spring model of one's own: how stiff each spring is, then how far the model can be trusted.
//
// A calibration fills the springs of a model whose nodes are there. One that is to be chosen in scenes stands in
// a file of massspring/calibrations and in the table of calibrate.cpp; nothing else knows it.
#include <cstdio>

#include "massspring/calibrations/calibrate.h"
#include "massspring/calibrations/calibrations.h"
#include "massspring/statics/diagnostics.h"
#include "meshing/network/build_network.h"

namespace testbed::massspring {

// 1. The rule: stiffness in proportion to 1/r, so that every spring is a rod of one cross-section, at the scale
//    of affine theory, E = sum k r^2 / (6 V) [(15)].
void calibrate_rods(MassSpringModel& model, const Eigen::Matrix2Xi& links) {
  const Eigen::VectorXd r2 = squared_lengths(model.network.X, links);
  const double V = lumped_mass(model.network.X, model.network.T, 1).sum();  // m3
  const double area = 6 * V * model.material.E / r2.cwiseSqrt().sum();
  set_springs(model, links, area * r2.cwiseSqrt().cwiseInverse());
}

}  // namespace testbed::massspring

int main() {
  using namespace testbed;
  using namespace testbed::massspring;

  // 2. A ball with tetrahedra; the springs are links that leave no motion without energy.
  NetworkOptions options;
  options.connectivity = "completed_pcp";
  SurfaceSource ball;
  ball.shape = "ball";
  ball.n_vertices = 162;
  const SpringNetwork network = build_network(load_surface(ball), options, true, true);

  // 3. The entry of the table: name, needs links, needs tetrahedra, is coupled, range of nu, rule.
  const Calibration rods{"rods", true, true, false, -1, 0.5, calibrate_rods};

  // 4. Beside known models: errors of two exact fields, and the work of bending over the exact one.
  double pressure_error = 1;
  for (const Calibration& calibration :
       {rods, find_calibration("affine"), find_calibration("node_averaged")}) {
    const Diagnostics found = diagnose(calibrate(network, Material{}, calibration));
    std::printf("%-14s pressure %6.3f, uniaxial %6.3f, bending %6.3f\n", calibration.name.c_str(),
                found.pressure_error, found.uniaxial_error, found.bending_compliance);
    if (calibration.name == "rods") pressure_error = found.pressure_error;
  }
  return pressure_error > 1e-3 && pressure_error < 1 ? 0 : 1;  // springs of one rule are no continuum
}
