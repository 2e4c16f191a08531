#include "meshing/surface_energies/enclosed_volume.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>

#include "meshing/surface/surface.h"
#include "meshing/surface_energies/surface_points.h"

namespace testbed::meshing {

Eigen::VectorXi Faces::nodes(Eigen::Index t) const {
  Eigen::VectorXi nodes(is_curved() ? 6 : 3);
  nodes.head<3>() = F.col(t);
  if (is_curved()) nodes.tail<3>() = middles.col(t);
  return nodes;
}

Faces faces_of(const Eigen::MatrixXi& nodes) {
  Faces faces{nodes.topRows<3>()};
  if (nodes.rows() == 6) faces.middles = nodes.bottomRows<3>();
  return faces;
}

double volume_and_gradient(const Eigen::Matrix3Xi& F, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) {
  gradient.setZero(3, F.cols() > 0 ? F.maxCoeff() + 1 : 0);
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

double volume_and_gradient(const Faces& faces, const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& gradient) {
  if (!faces.is_curved()) return volume_and_gradient(faces.F, x, gradient);
  gradient.setZero(3, std::max(faces.F.maxCoeff(), faces.middles.maxCoeff()) + 1);
  double V = 0;
  for (Eigen::Index t = 0; t < faces.F.cols(); ++t) {
    const Eigen::VectorXi nodes = faces.nodes(t);
    const EnclosedVolume v = enclosed_volume(x(Eigen::all, nodes));
    V += v.volume;
    gradient(Eigen::all, nodes) += v.gradient;
  }
  return V;
}

double volume_of(const Faces& faces, const Eigen::Matrix3Xd& x) {
  if (!faces.is_curved()) return volume(x, faces.F);
  double V = 0;
  for (Eigen::Index t = 0; t < faces.F.cols(); ++t)
    V += enclosed_volume(x(Eigen::all, faces.nodes(t))).volume;
  return V;
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

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  return (Eigen::Matrix3d() << 0, -v(2), v(1), v(2), 0, -v(0), -v(1), v(0), 0).finished();
}

}  // namespace

EnclosedVolume enclosed_volume(const Eigen::Matrix3Xd& x) {
  const Eigen::Index n = x.cols();
  EnclosedVolume v{0, Eigen::Matrix3Xd::Zero(3, n), Eigen::MatrixXd::Zero(3 * n, 3 * n)};
  struct Orbit {  // three points with two equal barycentric coordinates, of degree 4 [Dunavant 1985]
    double weight, equal;
  };
  constexpr Orbit kRule[] = {{0.10995174365532187, 0.091576213509770743},
                             {0.22338158967801147, 0.44594849091596489}};
  for (const auto& [weight, equal] : kRule)
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3d l = Eigen::Vector3d::Constant(equal);
      l(k) = 1 - 2 * equal;
      const double w = weight / 6;
      const Eigen::Matrix3Xd N = shape_functions(n, l(1), l(2));
      const Eigen::Matrix3d at = x * N.transpose();  // x, dx/dr, dx/ds
      v.volume += w * at.determinant();
      Eigen::Matrix3d cofactors;
      for (int c = 0; c < 3; ++c) cofactors.col(c) = at.col((c + 1) % 3).cross(at.col((c + 2) % 3));
      v.gradient += w * cofactors * N;
      for (int a = 0; a < n; ++a)
        for (int b = 0; b < n; ++b)
          // d2 det(x, y, z) / dx_a dx_b: antisymmetric in the functions and in the components.
          v.hessian.block<3, 3>(3 * a, 3 * b) +=
              w * cross_matrix(at * N.col(b).head<3>().cross(N.col(a).head<3>()));
    }
  return v;
}

}  // namespace testbed::meshing
