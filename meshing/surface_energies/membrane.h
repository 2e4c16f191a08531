// The surface resists stretching and shearing in its plane [Delingette 2008].
#pragma once

#include <optional>

#include "meshing/scene/scene.h"
#include "meshing/surface_energies/bending.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// What a membrane's rest lengths do in time.
struct Relaxation {
  double coefficient;         ///< R', the part lost in a second where the surface is bent most [paper eq. 9]
  Bending bending;            ///< of the same triangles
  LargestOf largest_of = {};  ///< as relax
};

/// What a collapse leaves of a membrane's rest lengths, each at the middle of its edge.
struct ShrinkingRest {
  Collapse collapse;
  double shortest_side;   ///< m
  Eigen::Matrix3d frame;  ///< turns nodes to where the scene's pivots have them
  bool is_static;
};

/// An isotropic St. Venant-Kirchhoff membrane in plane stress. On flat triangles its energy is a quadratic form
/// of the changes q_i = l_i^2 - r_i^2 of squared edges [Delingette 2008],
///   W = 1/2 sum_T q^T D_T q,
/// which is A K / (2 (1 - nu^2)) ((1 - nu) E:E + nu (tr E)^2) of the triangle's Green strain E.
class Membrane : public SurfaceEnergy {
 public:
  /// @param X  nodes at rest (3 x n, m)
  /// @param F  triangles
  /// @param stiffness  K (N/m): thickness times Young's modulus
  /// @param nu  Poisson's ratio
  Membrane(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F, double stiffness, double nu,
           std::optional<Relaxation> relaxation = {}, std::optional<ShrinkingRest> shrinking = {});

  /// Some triangles alone from here on, which does not change what becomes of rest lengths.
  void keep(const std::vector<int>& triangles);

  const char* name() const override { return "membrane"; }
  double energy(const Eigen::Matrix3Xd& x) const override;
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  /// Projected: without what compressed edges make indefinite.
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;
  /// Rest lengths shrink, and relax for h seconds where the surface is bent at x.
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  /// Rest lengths, where they change.
  std::shared_ptr<const SurfaceMemory> memory() const override {
    return relaxation_ || shrinking_ ? memory_ : nullptr;
  }
  void remember(std::shared_ptr<const SurfaceMemory> memory) override { memory_ = std::move(memory); }

 private:
  Eigen::Matrix3Xd middles(const Eigen::Matrix3Xd& x) const;
  template <class Visit>
  void for_each_triangle(const Eigen::Matrix3Xd& x, const Visit& visit) const;

  Eigen::Matrix3Xi F_;
  Eigen::Matrix2Xi E_;              ///< edges
  Eigen::Matrix3Xi edge_;           ///< of each triangle: from its first to its second corner, and so on
  std::vector<Eigen::Matrix3d> D_;  ///< of each triangle (J/m4)
  std::optional<Relaxation> relaxation_;
  std::optional<ShrinkingRest> shrinking_;
  Eigen::Matrix3Xd middles_;                     ///< of edges, at rest
  Eigen::VectorXd first_length_;                 ///< of edges (m)
  std::shared_ptr<const SurfaceMemory> memory_;  ///< rest lengths
};

/// The skin of a scene on the faces of a body: membrane and bending of their flat triangles.
/// @param X  nodes at rest (3 x n, m)
/// @param faces  3 or 6 nodes each
/// @param frame  turns X to where the scene has them
/// @param shortest_side  of the surface's box (m)
/// @param is_counted  of triangles and hinges; absent: all are
/// @param largest_of  as relax
SurfaceEnergies skin_of(const Scene& scene, const Eigen::Matrix3Xd& X, const Eigen::MatrixXi& faces,
                        const Eigen::Matrix3d& frame, double shortest_side, const IsCounted& is_counted = {},
                        const LargestOf& largest_of = {});

}  // namespace testbed::meshing
