// Node vectors padded to four doubles, so that each is loaded and stored whole.
#pragma once

#include <Eigen/Core>

#include "meshing/algebra/subdomains.h"
#include "meshing/algebra/vectors.h"

namespace testbed::massspring {

/// Room for n columns that begins where a register does.
Double4* columns(Eigen::Matrix4Xd& room, Eigen::Index n);

/// A column for each node of a field (3 x n), until the thread calls it again; the fourth number is 0.
const Double4* pad(const Eigen::Matrix3Xd& in);

/// Zero columns for n nodes, until the thread calls it again.
Double4* zero_columns(Eigen::Index n);

/// Calls sum(a column of in for each node; columns that it adds to, from zero), and adds the result to out.
template <class Sum>
void add_padded(const Sum& sum, const Eigen::Matrix3Xd& in, Eigen::Matrix3Xd& out) {
  Double4* const columns = zero_columns(in.cols());
  sum(pad(in), columns);
  for_each_chunk(in.cols(), [&](Eigen::Index begin, Eigen::Index end) {
    for (Eigen::Index i = begin; i < end; ++i)
      for (int k = 0; k < 3; ++k) out(k, i) += columns[i][k];
  });
}

}  // namespace testbed::massspring
