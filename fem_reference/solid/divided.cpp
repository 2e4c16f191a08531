#include "fem_reference/solid/divided.h"

#include <utility>

namespace testbed::fem {

using Eigen::Matrix3Xd;

DividedPressure::DividedPressure(meshing::SurfaceEnergies part, const Share& share)
    : part_(std::move(part)), share_(share) {}

void DividedPressure::set_load_factor(double factor) {
  for (const auto& pressure : part_) pressure->set_load_factor(factor);
}

double DividedPressure::energy(const Matrix3Xd& x) const {
  Matrix3Xd forces = Matrix3Xd::Zero(3, x.cols());
  add_forces(x, forces);
  share_.clear_ghosts(forces);
  return -forces.cwiseProduct(x).sum() / 3;
}

void DividedPressure::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for (const auto& pressure : part_) pressure->add_forces(x, f);
}

void DividedPressure::add_hessian(const Matrix3Xd& x, meshing::SurfaceHessian& H,
                                  meshing::Curvature curvature) const {
  for (const auto& pressure : part_) pressure->add_hessian(x, H, curvature);
}

std::vector<meshing::Contact> DividedSum::contacts(const Matrix3Xd& x) const {
  std::vector<meshing::Contact> with = counted_->contacts(x);
  for (meshing::Contact& contact : with) {
    sum_over_processes(contact.force);
    contact.area = sum_over_processes(contact.area);
  }
  return with;
}

bool DividedSum::keep_out(const Matrix3Xd& x, Matrix3Xd& y) const {
  constexpr int kMaxSweeps = 20;
  int n = 0;
  while (n < kMaxSweeps && largest_over_processes(acting_->keep_out(x, y)) > 0) {
    share_.exchange.update(y);
    ++n;
  }
  return n > 0;
}

}  // namespace testbed::fem
