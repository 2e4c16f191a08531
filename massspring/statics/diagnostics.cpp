#include "massspring/statics/diagnostics.h"

#include "massspring/energies/tractions.h"
#include "massspring/statics/exact_fields.h"
#include "massspring/statics/linear_statics.h"

namespace testbed::massspring {

using Eigen::Matrix3Xd;

Diagnostics diagnose(const MassSpringModel& model) {
  constexpr double kTolerance = 1e-10;  // far below any error worth showing
  const TetMesh& network = model.network;
  LinearStatics statics(model, hold_rigid_motion(network.X));
  Diagnostics result;
  result.node_error = Eigen::VectorXd::Zero(network.X.cols());

  struct Solution {
    Matrix3Xd u, exact;
    double compliance;
  };
  const auto solve = [&](const char* name) {
    const ExactField field = exact_field(name, lame_of(model.material), network.X.rowwise().mean());
    const Matrix3Xd f = traction_forces(field.stress, network.X, network.F);
    Solution solution{{}, displacements(field, network.X), 0};
    statics.solve(f, solution.u, kTolerance);
    solution.compliance = f.cwiseProduct(solution.u).sum() / f.cwiseProduct(solution.exact).sum();
    return solution;
  };
  const auto patch_error = [&](const char* name) {
    const Solution s = solve(name);
    return surface_error(s.u, s.exact, network.X, network.F).l2;
  };
  const auto compliance = [&](const char* name) {
    const Solution s = solve(name);
    result.node_error = result.node_error.cwiseMax(node_errors(s.u, s.exact, network.X));
    return s.compliance;
  };
  result.pressure_error = patch_error("pressure");
  result.uniaxial_error = patch_error("uniaxial");
  result.bending_compliance = compliance("bending");
  result.torsion_compliance = compliance("torsion");
  return result;
}

}  // namespace testbed::massspring
