// What acts on the surface of a body that several processes share.
#pragma once

#include <memory>

#include "fem_reference/elements/share.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::fem {

/// Follower pressures on a share's part of a body's surface.
class DividedPressure : public meshing::SurfaceEnergy {
 public:
  DividedPressure(meshing::SurfaceEnergies part, const Share& share);

  const char* name() const override { return "pressure"; }
  void set_load_factor(double factor) override;
  /// What this process counts. The volume is of third degree in x: a third of the work of its forces [Euler].
  double energy(const Eigen::Matrix3Xd& x) const override;
  double stored(const Eigen::Matrix3Xd& x) const override { return sum_over_processes(energy(x)); }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  void add_hessian(const Eigen::Matrix3Xd& x, meshing::SurfaceHessian& H,
                   meshing::Curvature curvature) const override;

 private:
  meshing::SurfaceEnergies part_;
  const Share& share_;
};

/// An energy that is a sum over parts of the surface.
class DividedSum : public meshing::SurfaceEnergy {
 public:
  /// @param acting   all parts that act on nodes of this process
  /// @param counted  those that no other process counts
  DividedSum(std::shared_ptr<SurfaceEnergy> acting, std::shared_ptr<SurfaceEnergy> counted)
      : acting_(std::move(acting)), counted_(std::move(counted)) {}

  const char* name() const override { return acting_->name(); }
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override {
    for (const auto& energy : {acting_, counted_}) energy->begin_step(t, h, x);
  }
  double energy(const Eigen::Matrix3Xd& x) const override { return counted_->energy(x); }
  double stored(const Eigen::Matrix3Xd& x) const override { return sum_over_processes(counted_->stored(x)); }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override {
    acting_->add_forces(x, f);
  }
  void add_hessian(const Eigen::Matrix3Xd& x, meshing::SurfaceHessian& H,
                   meshing::Curvature curvature) const override {
    acting_->add_hessian(x, H, curvature);
  }
  bool is_invariant() const override { return acting_->is_invariant(); }

 private:
  std::shared_ptr<SurfaceEnergy> acting_, counted_;
};

}  // namespace testbed::fem
