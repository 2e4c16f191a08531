#include "fem_reference/base/rigid.h"

#include <Eigen/Geometry>

namespace testbed::fem {

Eigen::MatrixXd rigid_motions(const Eigen::Matrix3Xd& X) {
  const Eigen::Vector3d centre = X.rowwise().mean();
  const double size = (X.colwise() - centre).colwise().norm().maxCoeff();
  Eigen::MatrixXd R(X.size(), 6);
  for (int i = 0; i < X.cols(); ++i) {
    R.block<3, 3>(3 * i, 0).setIdentity();
    for (int k = 0; k < 3; ++k)
      R.block<3, 1>(3 * i, 3 + k) = Eigen::Vector3d::Unit(k).cross((X.col(i) - centre) / size);
  }
  return R;
}

}  // namespace testbed::fem
