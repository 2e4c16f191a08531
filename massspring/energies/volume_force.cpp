#include "massspring/energies/volume_force.h"

#include <Eigen/Geometry>
#include <cmath>

#include "meshing/surface/surface.h"

namespace testbed::massspring {

double volume_and_gradient(const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) {
  gradient.setZero(3, F.maxCoeff() + 1);
  const Eigen::Vector3d origin = x.col(0);
  double V = 0;
  for (const auto& t : F.colwise()) {
    const Eigen::Vector3d a = x.col(t(0)), b = x.col(t(1)), c = x.col(t(2));
    const Eigen::Vector3d sixth = (b - a).cross(c - a) / 6;
    V += (a - origin).dot(sixth);
    for (int i : t) gradient.col(i) += sixth;
  }
  return V;
}

double volume_energy(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x) {
  const double excess = volume(x, F) - target;
  return P / 2 * excess * excess / target;
}

void add_volume_forces(double P, double target, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                       Eigen::Matrix3Xd& f) {
  thread_local Eigen::Matrix3Xd gradient;  // kept, so that a step allocates nothing
  const double V = volume_and_gradient(F, x, gradient);
  f.leftCols(gradient.cols()) += P * (target - V) / target * gradient;
}

Eigen::Matrix3Xd volume_stiffness_root(double P, double target, const Eigen::Matrix3Xi& F,
                                       const Eigen::Matrix3Xd& x) {
  Eigen::Matrix3Xd g;
  volume_and_gradient(F, x, g);
  return std::sqrt(P / target) * g;
}

void add_rank_one(const Eigen::Matrix3Xd& g, const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) {
  y.leftCols(g.cols()) += g.cwiseProduct(p.leftCols(g.cols())).sum() * g;
}

void add_volume_curvature(double factor, const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x,
                          const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) {
  for (const auto& t : F.colwise()) {
    const Eigen::Vector3d e = x.col(t(1)) - x.col(t(0)), f = x.col(t(2)) - x.col(t(0));
    const Eigen::Vector3d de = p.col(t(1)) - p.col(t(0)), df = p.col(t(2)) - p.col(t(0));
    const Eigen::Vector3d change = factor / 6 * (de.cross(f) + e.cross(df));
    for (int i : t) y.col(i) += change;
  }
}

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

void add_hessian(const LocalVolume& local, const Eigen::Matrix3Xd& x, BlockMatrix& K) {
  for (Eigen::Index t = 0; t < local.T.cols(); ++t) {
    const auto gradient = volume_and_gradient(local.T.col(t), x).gradient;
    for (int k = 0; k < 4; ++k)
      for (int l = 0; l < 4; ++l)
        K.block[K.find(local.T(k, t), local.T(l, t))] +=
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
