#include "fem_reference/solid/central_differences.h"

#include <cmath>
#include <memory>

#include "fem_reference/base/processes.h"
#include "meshing/algebra/largest_eigenvalue.h"
#include "meshing/algebra/subdomains.h"
#include "meshing/base/random.h"
#include "meshing/scene/scene.h"

namespace testbed::fem {
namespace {

using Eigen::VectorXd;

VectorXd inverse_of_free(const Dynamics& system) {
  const VectorXd mass = system.M.diagonal();
  VectorXd inverse = (mass.array() > 0).select(mass.cwiseInverse(), 0);
  inverse(system.constrained).setZero();
  return inverse;
}

}  // namespace

CentralDifferences::CentralDifferences(Dynamics system, double h) : Integrator(std::move(system), h) {
  find_free();
  const auto n = system_.M.rows();
  restart(VectorXd::Zero(n), VectorXd::Zero(n));
}

std::string CentralDifferences::solver() const {
  return "central differences";
}

void CentralDifferences::find_free() {
  inverse_mass_ = inverse_of_free(system_);
}

/// The acceleration that u_ has without damping, which a_ is, 0 of constrained unknowns, and the velocity that it gives within a time.
void CentralDifferences::accelerate(double time) {
  if (system_.forces)
    system_.forces(u_, force_);
  else
    force_ = respond(u_, false).force.reshaped(3, u_.size() / 3);
  a_.resize(u_.size());
  meshing::for_each_chunk(force_.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    const auto first = 3 * begin, m = 3 * (end - begin);
    auto a = a_.segment(first, m), v = v_.segment(first, m);
    a = inverse_mass_.segment(first, m).cwiseProduct(system_.load.segment(first, m) -
                                                     force_.reshaped().segment(first, m));
    v = (v + time * a) / (1 + time * system_.damping);
  });
}

void CentralDifferences::go_on(const VectorXd& u, const VectorXd& v) {
  start_at(u, v);
  accelerate(0);
}

bool CentralDifferences::step() {
  begin_step();
  const ConstrainedState constrained = constrained_at(t() + h_);
  // Damping is taken at the mean of the velocities in the middle of two steps.
  meshing::for_each_chunk(force_.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    const auto first = 3 * begin, m = 3 * (end - begin);
    auto u = u_.segment(first, m), v = v_.segment(first, m);
    v += h_ / 2 * (a_.segment(first, m) - system_.damping * v);
    u += h_ * v;
  });
  u_(system_.constrained) = constrained.u;
  if (system_.exchange) system_.exchange(u_);
  accelerate(h_ / 2);
  v_(system_.constrained) = constrained.v;
  ++n_steps_;
  constexpr double kRunaway = 1e30;  // m/s: energies, areas and strains are still numbers
  return sum_over_processes(v_.squaredNorm()) < kRunaway * kRunaway;
}

std::unique_ptr<Integrator> make_central_differences(Dynamics system, double h, const ReferenceOptions&) {
  return std::make_unique<CentralDifferences>(std::move(system), h);
}

double stable_step(const Dynamics& system) {
  const VectorXd scale = inverse_of_free(system).cwiseSqrt();
  const auto n = scale.size() / 3;
  Random random(1);
  Eigen::Matrix3Xd start(3, n);
  for (double& s : start.reshaped()) s = random.uniform() - 0.5;
  start.reshaped().array() *= (scale.array() > 0).cast<double>();
  const double largest = meshing::largest_eigenvalue(
      [&](const Eigen::Matrix3Xd& q) -> Eigen::Matrix3Xd {
        VectorXd scaled = scale.cwiseProduct(q.reshaped());
        if (system.exchange) system.exchange(scaled);
        return scale.cwiseProduct(system.K * scaled).reshaped(3, n);
      },
      start,
      [](const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b) {
        return sum_over_processes(a.cwiseProduct(b).sum());
      });
  return 2 / std::sqrt(largest);
}

}  // namespace testbed::fem
