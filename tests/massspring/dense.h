// Matrices written out, for dense solvers.
#pragma once

#include <Eigen/Core>

#include "massspring/model/model.h"
#include "meshing/base/geometry.h"

namespace testbed::massspring {

inline Eigen::MatrixXd dense(const BlockMatrix& A) {
  Eigen::MatrixXd D = Eigen::MatrixXd::Zero(3 * A.rows(), 3 * A.rows());
  for (int i = 0; i < A.rows(); ++i)
    for (int k = A.row_start[i]; k < A.row_start[i + 1]; ++k)
      D.block<3, 3>(3 * i, 3 * A.column[k]) = A.block[k];
  return D;
}

/// At rest.
inline Eigen::MatrixXd dense_stiffness(const MassSpringModel& model) {
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, initial_state(model), K);
  return dense(K);
}

/// The integral of rho N_i N_j over every tetrahedron.
inline Eigen::MatrixXd consistent_mass(const MassSpringModel& model) {
  Eigen::MatrixXd M = Eigen::MatrixXd::Zero(3 * model.mass.size(), 3 * model.mass.size());
  for (const auto& t : model.network.T.colwise())
    for (int i : t)
      for (int j : t)
        M.block<3, 3>(3 * i, 3 * j).diagonal().array() +=
            (i == j ? 2 : 1) * model.material.rho * tet_volume(model.network.X, t) / 20;
  return M;
}

}  // namespace testbed::massspring
