// The lowest modes of a stiffness and a mass.
#pragma once

#include <Eigen/Core>
#include <functional>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// Operators on columns of N values, symmetric in the Euclidean product.
struct Pencil {
  using Operator = std::function<Eigen::MatrixXd(const Eigen::MatrixXd&)>;
  Operator stiffness;  ///< K, positive semidefinite
  Operator mass;       ///< M, positive definite on what `inverse` gives
  Operator inverse;    ///< (K + s M)^-1, s > 0 far below the lowest eigenvalue that is not zero
  Eigen::Index n_rows;
  double zero;  ///< eigenvalues below count as none: motions without energy
  /// Makes sums over rows those over all processes that share them; of one process there is nothing to add.
  std::function<void(Eigen::MatrixXd& sums)> add_up = [](Eigen::MatrixXd&) {};
};

/// The pencil of the stiffness K + U U^T, U of few columns, such as gradients of the enclosed volume, by the
/// formula of Sherman, Morrison and Woodbury.
Pencil with_roots(const Pencil& pencil, const Eigen::MatrixXd& U);

/// Of K x = lambda M x.
struct LowestModes {
  Eigen::VectorXd eigenvalue;  ///< ascending, without those that count as zero
  Eigen::MatrixXd shape;       ///< N x n, its columns orthonormal in M
  int n_zero = 0;              ///< motions without energy: rigid and floppy ones
};

/// The n lowest modes that are not zero, fewer where there are no more, repeated ones as often as they are
/// repeated: a block as large as all wanted modes is iterated inversely, each time with the best of a Krylov
/// space of three blocks [Parlett 1998, chapter 13]. A single vector would find one of each repeated mode.
/// @throws std::runtime_error when the iteration does not converge
LowestModes lowest_modes(const Pencil& pencil, int n);

}  // namespace testbed::meshing
