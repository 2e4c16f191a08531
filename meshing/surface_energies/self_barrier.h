// The surface against itself: vertices against triangles and edges against edges, kept apart by a barrier.
#pragma once

#include <vector>

#include "meshing/surface_energies/near_pairs.h"
#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// An energy of pairs that rises without bound as they meet [Li et al. 2020],
///   kappa sum w m b(d), b(d) = -(d - D)^2 ln(d/D) for d < D, else 0, [(26)]
/// d the distance of a vertex and a triangle or of two edges, and m what smoothing_of_edges leaves of the latter.
/// w is a quarter of a vertex's third of its triangles, or of the mean of two edges' thirds: two layers then have
/// about kappa b(d) for each area while their edges are 4 D or more; where they are shorter a point meets several
/// parts, and has more. kappa is E/(50 D) as of barrier_around.
/// Pairs that share a node do not count. D of others is half of their distance at rest at most, so that there is no
/// energy at rest, and nothing where they touch there.
/// Coulomb's friction is lagged as that of Barrier.
class SelfBarrier : public SurfaceEnergy {
 public:
  /// @param X  3 x n nodes at rest (m)
  /// @param F  triangles, 3 x m, of nodes of which some may be none of the surface
  /// @param E  Young's modulus (Pa)
  /// @param thickness  D (m)
  /// @param friction  Coulomb's coefficient
  /// @param is_counted  of pairs; absent: all are
  SelfBarrier(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F, double E, double thickness,
              double friction = 0, IsCounted is_counted = {});

  const char* name() const override { return "self_contact"; }
  double energy(const Eigen::Matrix3Xd& x) const override;  ///< J; infinite where pairs touch
  double stored(const Eigen::Matrix3Xd& x) const override;
  double friction(const Eigen::Matrix3Xd& x) const override;
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;
  void begin_step(double t, double h, const Eigen::Matrix3Xd& x) override;
  /// Takes all nodes back on their way from x to y until nothing passes through.
  bool keep_out(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& y) const override;
  bool passes_through(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) const override;
  /// By additive continuous collision detection [Li et al. 2021], which leaves pairs a tenth of their distance,
  /// or of their range where that is less. No node moves farther than a mean edge against the others.
  double largest_step(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx) const override;
  void follow(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) override;
  bool bounds_steps() const override { return true; }
  bool is_stiff() const override { return true; }
  bool is_invariant() const override { return friction_ == 0; }

 protected:
  /// The part of dx within which pairs keep a part of their distance.
  virtual double time_of_impact(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx, double kept) const;

 private:
  struct Pair {
    PairNodes node;
    bool is_edges;
    double range, stiffness, least;  ///< m, kappa w (N/m), least_cross (m4)
  };
  struct Held {
    PairNodes node;
    PairWeights weight;
    Eigen::Vector3d normal, start;  ///< start: from the second part to the first as the step began (m)
    double limit;                   ///< friction coefficient times contact force (N)
    Eigen::Vector3d friction;       ///< as foreseen (N)
  };
  struct Near;
  double moved(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& y) const;
  void list(const Eigen::Matrix3Xd& x, double margin) const;
  const std::vector<Pair>& pairs_at(const Eigen::Matrix3Xd& x) const;
  const std::vector<Pair>& pairs_along(const Eigen::Matrix3Xd& x, const Eigen::Matrix3Xd& dx) const;
  Eigen::Vector3d slid(const Held& held, const Eigen::Matrix3Xd& x) const;
  template <class Visit>
  void for_each_near(const Eigen::Matrix3Xd& x, const Visit& visit) const;

  Eigen::Matrix3Xd X_;
  Eigen::Matrix3Xi F_;
  Eigen::Matrix2Xi E_;
  Eigen::VectorXi vertices_;
  Eigen::VectorXd vertex_area_, edge_area_;  ///< m2: of nodes, and of the pair of nodes of each edge
  double thickness_, kappa_, friction_, mean_edge_;
  IsCounted is_counted_;
  double slip_ = 0;  ///< below which friction is smoothed (m)
  std::vector<Held> held_;
  // Kept: all pairs that may come as near as D while no node moves farther than the margin against the others.
  mutable Eigen::Matrix3Xd listed_;
  mutable double margin_ = 0;
  mutable std::vector<Pair> pairs_;
};

/// The thickness of a scene that names none: a fifth of the surface's mean edge (m).
double default_thickness(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

}  // namespace testbed::meshing
