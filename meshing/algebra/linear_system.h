// What a solver may ask of a linear system.
#pragma once

#include <functional>
#include <vector>

#include "meshing/algebra/block_matrix.h"
#include "meshing/algebra/single_precision.h"

namespace testbed::meshing {

/// A symmetric positive definite system on the directions that constraints leave free.
struct LinearSystem {
  std::function<void(const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y)> product;  ///< y = A p, 3 x n
  /// The same in single precision; p . y.
  std::function<double(const PaddedField& p, PaddedField& y)> single_product;
  std::function<void(Eigen::Matrix3Xd& y)> constrain;  ///< takes away constrained directions, node by node
  std::function<void(Eigen::Matrix3Xd& y)> filter;     ///< these, and motions that are kept out
  std::function<void(PaddedField& y)> single_filter;   ///< the same in single precision
  std::function<void(std::vector<Eigen::Matrix3d>&)> diagonal;  ///< diagonal blocks of A
  /// A, or what is near it: only to make a preconditioner of.
  std::function<const BlockMatrix&()> matrix;
  const Eigen::Matrix3Xd* positions;  ///< of the nodes, 3 x n (m)
};

}  // namespace testbed::meshing
