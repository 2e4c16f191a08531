#include "massspring/energies/local_volume.h"

#include <Eigen/Geometry>

namespace testbed::massspring {

namespace {

struct TetVolume {
  double volume;
  Eigen::Matrix<double, 3, 4> gradient;
};

TetVolume volume_and_gradient(const Eigen::Vector4i& t, const Eigen::Matrix3Xd& x) {
  const Eigen::Vector3d a = x.col(t[1]) - x.col(t[0]), b = x.col(t[2]) - x.col(t[0]),
                        c = x.col(t[3]) - x.col(t[0]);
  TetVolume tet;
  tet.gradient.rightCols<3>() << b.cross(c) / 6, c.cross(a) / 6, a.cross(b) / 6;
  tet.gradient.col(0) = -tet.gradient.rightCols<3>().rowwise().sum();
  tet.volume = a.dot(tet.gradient.col(1));
  return tet;
}

}  // namespace

double energy(const LocalVolume& local, const Eigen::Matrix3Xd& x) {
  double sum = 0;
  for (Eigen::Index t = 0; t < local.T.cols(); ++t) {
    const double excess = volume_and_gradient(local.T.col(t), x).volume - local.rest_volume[t];
    sum += local.kappa / 2 * excess * excess / local.rest_volume[t];
  }
  return sum;
}

void add_forces(const LocalVolume& local, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) {
  for (Eigen::Index t = 0; t < local.T.cols(); ++t) {
    const TetVolume tet = volume_and_gradient(local.T.col(t), x);
    const double pressure = local.kappa * (1 - tet.volume / local.rest_volume[t]);
    for (int k = 0; k < 4; ++k) f.col(local.T(k, t)) += pressure * tet.gradient.col(k);
  }
}

void add_hessian(const LocalVolume& local, const Eigen::Matrix3Xd& x, BlockMatrix& K, Curvature) {
  for (Eigen::Index t = 0; t < local.T.cols(); ++t) {
    const auto gradient = volume_and_gradient(local.T.col(t), x).gradient;
    for (int k = 0; k < 4; ++k)
      for (int l = 0; l < 4; ++l)
        if (const int i = local.T(k, t), j = local.T(l, t); i <= j)
          K.block[K.find(i, j)] +=
              local.kappa / local.rest_volume[t] * gradient.col(k) * gradient.col(l).transpose();
  }
}

Eigen::Matrix2Xi pairs_of(const LocalVolume& local) {
  Eigen::Matrix2Xi pairs(2, 6 * local.T.cols());
  Eigen::Index p = 0;
  for (const auto& t : local.T.colwise())
    for (int k = 0; k < 4; ++k)
      for (int l = 0; l < k; ++l) pairs.col(p++) << t[k], t[l];
  return pairs;
}

}  // namespace testbed::massspring
