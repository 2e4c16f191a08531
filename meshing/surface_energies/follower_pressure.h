// A pressure that follows the surface as it deforms.
#pragma once

#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Energy p V (J) of a pressure p (Pa) on the deformed triangles of whole components of the surface, V the
/// volume they enclose: on each -p A n. A load.
class FollowerPressure : public SurfaceEnergy {
 public:
  FollowerPressure(double pressure, Faces faces) : pressure_(pressure), faces_(std::move(faces)) {}

  const char* name() const override { return "pressure"; }
  void set_load_factor(double factor) override { factor_ = factor; }
  double energy(const Eigen::Matrix3Xd& x) const override;
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override;
  /// Nothing of it is sure to be positive semidefinite.
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const override;

  double pressure() const { return pressure_; }  ///< at full strength (Pa)
  const Faces& faces() const { return faces_; }

 private:
  double pressure_, factor_ = 1;
  Faces faces_;
};

/// One for each pressure but 0.
/// @param pressure  of each triangle (Pa)
/// @param faces  their nodes, 3 or 6 rows
SurfaceEnergies followers_of(const Eigen::VectorXd& pressure, const Eigen::MatrixXi& faces);

}  // namespace testbed::meshing
