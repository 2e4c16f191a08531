// The product of springs' blocks with a vector, in single precision.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "meshing/algebra/single_precision.h"

namespace testbed::massspring {

/// Springs in rows, one for each node, of those that it is the first of.
class SpringRows {
 public:
  SpringRows(const Eigen::Matrix2Xi& springs, int n_nodes);

  /// Blocks in the order of the rows.
  Eigen::Matrix4Xf in_rows(const Eigen::Matrix4Xd& B) const;

  /// y += B p, B in rows; then p . y.
  double add_product(const Eigen::Matrix4Xf& B, const PaddedField& p, PaddedField& y) const;

 private:
  std::vector<int> start_;  ///< of each row, n_nodes + 1; rows are even, for two springs fill a register
  std::vector<int> other_;  ///< the second node; of what fills a row the first
  std::vector<int> at_;     ///< of each spring
};

}  // namespace testbed::massspring
