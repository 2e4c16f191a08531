// What acts on the surface of a body that several processes share.
#pragma once

#include <memory>

#include "fem_reference/elements/share.h"
#include "meshing/surface_energies/self_barrier.h"
#include "meshing/surface_energies/surface_energy.h"
#include "meshing/surface_energies/volume_penalty.h"

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

/// Pairs of a surface all of which every process has, with those of them that are counted here.
class DividedSelfBarrier : public meshing::SelfBarrier {
 public:
  using SelfBarrier::SelfBarrier;

 protected:
  double time_of_impact(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx, double kept) const override {
    return -largest_over_processes(-SelfBarrier::time_of_impact(x, dx, kept));
  }
};

/// An energy that is a sum over parts of the surface.
class DividedSum : public meshing::SurfaceEnergy {
 public:
  /// @param acting   all parts that act on nodes of this process
  /// @param counted  those that no other process counts
  DividedSum(const Share& share, std::shared_ptr<SurfaceEnergy> acting,
             std::shared_ptr<SurfaceEnergy> counted)
      : share_(share), acting_(std::move(acting)), counted_(std::move(counted)) {}

  const char* name() const override { return acting_->name(); }
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override {
    for (const auto& energy : {acting_, counted_}) energy->begin_step(t, h, x);
  }
  std::shared_ptr<const meshing::SurfaceMemory> memory() const override { return acting_->memory(); }
  void remember(std::shared_ptr<const meshing::SurfaceMemory> memory) override {
    for (const auto& energy : {acting_, counted_}) energy->remember(memory);
  }
  double energy(const Eigen::Matrix3Xd& x) const override { return counted_->energy(x); }
  double stored(const Eigen::Matrix3Xd& x) const override { return sum_over_processes(counted_->stored(x)); }
  double friction(const Eigen::Matrix3Xd& x) const override {
    return sum_over_processes(counted_->friction(x));
  }
  double work(const Eigen::Matrix3Xd& x) const override { return sum_over_processes(counted_->work(x)); }
  std::vector<meshing::Contact> contacts(const Eigen::Matrix3Xd& x) const override;
  /// Again and again, as nodes of a point may be other processes'.
  bool keep_out(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) const override;
  double largest_step(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx) const override {
    return -largest_over_processes(-acting_->largest_step(x, dx));
  }
  bool passes_through(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) const override {
    return largest_over_processes(acting_->passes_through(x, y)) > 0;
  }
  void follow(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) override {
    for (const auto& energy : {acting_, counted_}) energy->follow(x, y);
  }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override {
    acting_->add_forces(x, f);
  }
  void add_hessian(const Eigen::Matrix3Xd& x, meshing::SurfaceHessian& H,
                   meshing::Curvature curvature) const override {
    acting_->add_hessian(x, H, curvature);
  }
  bool bounds_steps() const override { return acting_->bounds_steps(); }
  bool is_stiff() const override { return acting_->is_stiff(); }
  bool is_invariant() const override { return acting_->is_invariant(); }

 private:
  const Share& share_;
  std::shared_ptr<SurfaceEnergy> acting_, counted_;
};

/// A VolumePenalty or HeldVolume whose faces are those of a share. All processes know the volume of the whole.
template <class Volume>
class DividedVolume : public Volume {
 public:
  DividedVolume(const Share& share, double P, meshing::Faces faces, const meshing::TargetVolume& target)
      : Volume(P, std::move(faces), target), share_(share) {}

  /// That of the whole, which the first process counts.
  double energy(const Eigen::Matrix3Xd& x) const override {
    const double whole = Volume::energy(x);
    return processes().rank == 0 ? whole : 0;
  }
  double stored(const Eigen::Matrix3Xd& x) const override { return sum_over_processes(Volume::stored(x)); }

 protected:
  double volume_at(const Eigen::Matrix3Xd& x) const override {
    Eigen::Matrix3Xd gradient;
    return volume_at(x, gradient);
  }
  /// The volume is of third degree in x: a third of the product with its gradient [Euler].
  double volume_at(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) const override {
    Volume::volume_at(x, gradient);
    double sum = 0;
    for (Eigen::Index i = 0; i < gradient.cols(); ++i)
      if (!share_.is_ghost[i]) sum += gradient.col(i).dot(x.col(i));
    return sum_over_processes(sum) / 3;
  }

 private:
  const Share& share_;
};

}  // namespace testbed::fem
