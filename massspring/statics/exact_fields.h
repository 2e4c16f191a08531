// Polynomial displacement fields that solve elasticity without body force, applied to any closed polyhedron
// as tractions: references without geometry error and without a reference solver.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "massspring/energies/tet_springs.h"

namespace testbed::massspring {

struct ExactField {
  std::function<Eigen::Vector3d(const Eigen::Vector3d&)> displacement;  ///< m
  std::function<Eigen::Matrix3d(const Eigen::Vector3d&)> stress;        ///< Pa, at most linear in x
};

/// pressure, uniaxial, shear, bending, torsion, cubic_harmonic.
const std::vector<std::string>& exact_field_names();

/// The field of that name about `centre`, strain of order 1 (at most linear fields) or 1/m (quadratic ones).
/// @throws std::runtime_error for an unknown name.
ExactField exact_field(const std::string& name, const Lame& lame, const Eigen::Vector3d& centre);

/// Its displacement at the points (3 x n, m).
Eigen::Matrix3Xd displacements(const ExactField& field, const Eigen::Matrix3Xd& X);

struct SurfaceError {
  double l2;       ///< area-weighted relative L2 norm
  double largest;  ///< largest error over the largest displacement
};

/// Difference of two displacement fields at the surface vertices (the first columns), relative to `exact`,
/// after the small rigid motion that fits best is taken out of both.
SurfaceError surface_error(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& exact,
                           const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F);

/// The same difference at every node, over the largest displacement; the rigid motion fits all nodes equally.
Eigen::VectorXd node_errors(const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& exact,
                            const Eigen::Matrix3Xd& X);

}  // namespace testbed::massspring
