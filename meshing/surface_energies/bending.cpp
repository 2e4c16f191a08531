#include "meshing/surface_energies/bending.h"

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <optional>

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Gradient = Eigen::Matrix<double, 3, 4>;

constexpr double kCrumpled = 0.1;  // of a triangle's area at rest

struct Angle {
  double theta;
  Gradient gradient;  ///< by x_0 ... x_3 (1/m)
};

/// Dihedral angle and its gradient [Bridson et al. 2003].
std::optional<Angle> angle_at(const Eigen::Vector4i& hinge, const Matrix3Xd& x) {
  const Vector3d x0 = x.col(hinge[0]), x1 = x.col(hinge[1]), x2 = x.col(hinge[2]), x3 = x.col(hinge[3]);
  const Vector3d e = x1 - x0, n1 = e.cross(x2 - x0), n2 = (x3 - x0).cross(e);
  const double length = e.norm(), q1 = n1.squaredNorm(), q2 = n2.squaredNorm();
  if (!(length > 0 && q1 > 0 && q2 > 0)) return {};
  Angle angle;
  angle.theta = std::atan2(n1.cross(n2).dot(e) / length, n1.dot(n2));
  const Vector3d g2 = -length / q1 * n1, g3 = -length / q2 * n2;
  const double t2 = (x2 - x0).dot(e) / (length * length), t3 = (x3 - x0).dot(e) / (length * length);
  angle.gradient << -(1 - t2) * g2 - (1 - t3) * g3, -t2 * g2 - t3 * g3, g2, g3;
  return angle;
}

/// Multiplies an angle and its gradient by t (2 - t) where the triangle (x_0, x_1, x_2 of which `third` is
/// the last) has shrunk to t < 1 times `least`: unbounded, the gradient would go with one over its height.
void fade(const Eigen::Vector4i& hinge, int third, double least, const Matrix3Xd& x, double& angle,
          Gradient& gradient) {
  const Vector3d x0 = x.col(hinge[0]), x1 = x.col(hinge[1]), x2 = x.col(hinge[third]);
  const Vector3d n = (x1 - x0).cross(x2 - x0);
  const double area = n.norm() / 2, t = area / least;
  if (t >= 1) return;
  gradient *= t * (2 - t);
  const Vector3d slope = angle * 2 * (1 - t) / least / (4 * area) * n;
  gradient.col(0) += (x1 - x2).cross(slope);
  gradient.col(1) += (x2 - x0).cross(slope);
  gradient.col(third) += (x0 - x1).cross(slope);
  angle *= t * (2 - t);
}

/// Calls visit(hinge number, stiffness, theta - theta_0 faded, its gradient).
template <class Visit>
void for_each_hinge(const Bending& bending, const Matrix3Xd& x, const Visit& visit) {
  for (int b = 0; b < bending.hinges.cols(); ++b) {
    const Eigen::Vector4i hinge = bending.hinges.col(b);
    auto bent = angle_at(hinge, x);
    if (!bent) continue;
    double angle = std::remainder(bent->theta - bending.rest_angle[b], 2 * M_PI);
    for (int side = 0; side < 2; ++side)
      fade(hinge, 2 + side, kCrumpled * bending.area(side, b), x, angle, bent->gradient);
    visit(b, bending.stiffness[b], angle, bent->gradient);
  }
}

}  // namespace

Bending make_bending(const Matrix3Xd& X, const Eigen::Matrix3Xi& F, double k_b) {
  std::map<std::pair<int, int>, int> opposite;  // of a directed edge: the third corner of its triangle
  for (const auto& t : F.colwise())
    for (int k = 0; k < 3; ++k) opposite[{t[k], t[(k + 1) % 3]}] = t[(k + 2) % 3];
  std::vector<Eigen::Vector4i> hinges;
  for (const auto& [edge, third] : opposite) {
    const auto [i, j] = edge;
    const auto other = opposite.find({j, i});
    if (i < j && other != opposite.end()) hinges.emplace_back(i, j, third, other->second);
  }
  Bending bending;
  const auto n = static_cast<Eigen::Index>(hinges.size());
  bending.hinges.resize(4, n);
  bending.area.resize(2, n);
  bending.rest_angle.resize(n);
  bending.stiffness.resize(n);
  for (Eigen::Index b = 0; b < n; ++b) {
    const Eigen::Vector4i& hinge = hinges[b];
    const Vector3d e = X.col(hinge[1]) - X.col(hinge[0]);
    for (int side = 0; side < 2; ++side)
      bending.area(side, b) = e.cross(X.col(hinge[2 + side]) - X.col(hinge[0])).norm() / 2;
    const auto angle = angle_at(hinge, X);
    bending.hinges.col(b) = hinge;
    bending.rest_angle[b] = angle ? angle->theta : 0;
    bending.stiffness[b] = angle ? k_b * e.squaredNorm() / bending.area.col(b).sum() : 0;
  }
  return bending;
}

Bending part_of(const Bending& bending, const std::vector<int>& hinges) {
  return {bending.hinges(Eigen::all, hinges), bending.area(Eigen::all, hinges), bending.rest_angle(hinges),
          bending.stiffness(hinges)};
}

double energy(const Bending& bending, const Matrix3Xd& x) {
  double sum = 0;
  for_each_hinge(bending, x,
                 [&](int, double k, double angle, const Gradient&) { sum += k / 2 * angle * angle; });
  return sum;
}

void add_forces(const Bending& bending, const Matrix3Xd& x, Matrix3Xd& f) {
  for_each_hinge(bending, x, [&](int b, double k, double angle, const Gradient& gradient) {
    for (int c = 0; c < 4; ++c) f.col(bending.hinges(c, b)) -= k * angle * gradient.col(c);
  });
}

void add_hessian(const Bending& bending, const Matrix3Xd& x, BlockMatrix& K) {
  for_each_hinge(bending, x, [&](int b, double k, double, const Gradient& gradient) {
    for (int c = 0; c < 4; ++c)
      for (int d = 0; d < 4; ++d)
        K.block[K.find(bending.hinges(c, b), bending.hinges(d, b))] +=
            k * gradient.col(c) * gradient.col(d).transpose();
  });
}

void add_hessian(const Bending& bending, const Matrix3Xd& x, SurfaceHessian& H) {
  for_each_hinge(bending, x, [&](int b, double k, double, const Gradient& gradient) {
    for (int c = 0; c < 4; ++c)
      for (int d = c; d < 4; ++d)
        H.blocks.push_back(
            {bending.hinges(c, b), bending.hinges(d, b), k * gradient.col(c) * gradient.col(d).transpose()});
  });
}

Eigen::Matrix2Xi pairs_of(const Bending& bending) {
  Eigen::Matrix2Xi pairs(2, 6 * bending.hinges.cols());
  Eigen::Index p = 0;
  for (const auto& hinge : bending.hinges.colwise())
    for (int c = 0; c < 4; ++c)
      for (int d = 0; d < c; ++d) pairs.col(p++) << hinge[c], hinge[d];
  return pairs;
}

Eigen::VectorXd mean_bending_forces(const Bending& bending, const Matrix3Xd& x) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(x.cols()), count = sum;
  for_each_hinge(bending, x, [&](int b, double k, double angle, const Gradient& gradient) {
    for (int c = 0; c < 2; ++c) {
      sum[bending.hinges(c, b)] += std::abs(k * angle) * gradient.col(c).norm();
      ++count[bending.hinges(c, b)];
    }
  });
  return sum.cwiseQuotient(count.cwiseMax(1));
}

void relax(const Bending& bending, const Eigen::Matrix2Xi& E, double coefficient, double h,
           const Matrix3Xd& x, Eigen::Ref<Eigen::VectorXd> rest_length) {
  const Eigen::VectorXd f = mean_bending_forces(bending, x);
  const double largest = f.maxCoeff();
  if (!(largest > 0)) return;
  for (Eigen::Index s = 0; s < E.cols(); ++s)
    rest_length(s) *= std::pow(1 - coefficient * (f(E(0, s)) + f(E(1, s))) / (2 * largest), h);
}

}  // namespace testbed::meshing
