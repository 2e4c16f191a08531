// The surface against itself: vertices against triangles and edges against edges, kept apart by a penalty.
#pragma once

#include "meshing/surface_energies/near_pairs.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Energy 1/2 k (D - d)^2 [(27)] of every pair closer than the thickness D. Their distance d is negative
/// where they have passed through each other since they met. Pairs that share a node or are as close at rest
/// do not count.
class SurfaceContact : public SurfaceEnergy {
 public:
  /// @param X  3 x n positions at rest (m)
  /// @param F  triangles, 3 x m
  /// @param E  Young's modulus (Pa); k is E times the surface's mean edge
  /// @param thickness  D (m)
  SurfaceContact(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F, double E, double thickness);

  const char* name() const override { return "self_contact"; }
  double energy(const Eigen::Matrix3Xd& x) const override;
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;
  /// Remembers on which side of each other pairs lie. Looks for pairs again when nodes have moved so far that
  /// new ones may have met.
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  std::shared_ptr<const SurfaceMemory> memory() const override { return memory_; }
  void remember(std::shared_ptr<const SurfaceMemory> memory) override { memory_ = std::move(memory); }
  bool is_stiff() const override { return true; }

 private:
  using Pair = SidedPair;
  Smoothing smoothing_of(const Pair& pair, const Eigen::Matrix3Xd& x) const;
  template <class Visit>
  void for_each_near(const Eigen::Matrix3Xd& x, const Visit& visit) const;
  std::shared_ptr<SurfaceMemory> find_pairs(const Eigen::Matrix3Xd& x) const;

  Eigen::Matrix3Xd X_;
  Eigen::Matrix3Xi F_;
  Eigen::Matrix2Xi E_;
  double thickness_, stiffness_;
  double margin_;  ///< beyond the thickness up to which pairs are listed (m)
  std::shared_ptr<const SurfaceMemory> memory_ = std::make_shared<const SurfaceMemory>();
};

}  // namespace testbed::meshing
