// An energy of one's own: every node is tied to where it was at rest, as in a bed of jelly.
//
// To be chosen in scenes it stands in massspring/energies, as a member of MassSpringModel and in the list
// elastic_energies of model.h; sums, forces, matrices and their patterns derive from that list.
#include <cmath>
#include <cstdio>

#include "massspring/calibrations/calibrate.h"
#include "meshing/algebra/cholesky.h"
#include "meshing/network/build_network.h"

namespace testbed::massspring {

// 1. Its parameters.
struct Bed {
  Eigen::Matrix3Xd X;  ///< 3 x n (m)
  double stiffness;    ///< N/m at each node
};

// 2. Its four verbs: W = sum_i k/2 |x_i - X_i|^2, the force -dW/dx, the Hessian and the pairs of nodes it couples.
double energy(const Bed& bed, const Eigen::Matrix3Xd& x) {
  return bed.stiffness / 2 * (x - bed.X).squaredNorm();
}
void add_forces(const Bed& bed, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) {
  f -= bed.stiffness * (x - bed.X);
}
void add_hessian(const Bed& bed, const Eigen::Matrix3Xd&, BlockMatrix& K, Curvature) {
  for (const int k : K.diagonal) K.block[k] += bed.stiffness * Eigen::Matrix3d::Identity();
}
Eigen::Matrix2Xi pairs_of(const Bed&) {
  return Eigen::Matrix2Xi(2, 0);  // each node by itself
}

}  // namespace testbed::massspring

int main() {
  using namespace testbed;
  using namespace testbed::massspring;

  // 3. A small ball of coupled springs in the bed, its nodes displaced at random.
  SurfaceSource source;
  source.shape = "ball";
  source.n_vertices = 42;
  const SpringNetwork network = build_network(load_surface(source), {}, false, true);
  const MassSpringModel model = calibrate(network, Material{}, find_calibration("edge_coupled"));
  const Bed bed{model.network.X, 2e3};
  State state = initial_state(model);
  state.x += 0.02 * Eigen::Matrix3Xd::Random(3, state.x.cols());

  // 4. Forces are minus the energy's gradient: a difference of energies along a direction says so.
  const auto total = [&] { return elastic_energy(model, state) + energy(bed, state.x); };
  Eigen::Matrix3Xd f = elastic_forces(model, state);
  add_forces(bed, state.x, f);
  const Eigen::Matrix3Xd direction = Eigen::Matrix3Xd::Random(3, f.cols()), start = state.x;
  constexpr double kStep = 1e-6;
  state.x = start + kStep * direction;
  const double above = total();
  state.x = start - kStep * direction;
  const double slope = (above - total()) / (2 * kStep), error = slope + f.cwiseProduct(direction).sum();
  std::printf("slope %.6f J, of which forces miss %.1e J\n", slope, error);

  // 5. Newton's method brings the ball back to rest.
  state.x = start;
  for (int n = 0; n < 20 && f.norm() > 1e-9; ++n) {
    BlockMatrix K = stiffness_pattern(model);
    add_stiffness(model, state, K);
    add_hessian(bed, state.x, K, Curvature::Exact);
    Eigen::Matrix3Xd dx;
    BlockCholesky(K).solve(f, dx);
    state.x += dx;
    f = elastic_forces(model, state);
    add_forces(bed, state.x, f);
    std::printf("Newton %d: |f| = %.1e N\n", n + 1, f.norm());
  }
  const double distance = (state.x - bed.X).norm();
  return std::abs(error) < 1e-5 * std::abs(slope) && distance < 1e-9 ? 0 : 1;
}
