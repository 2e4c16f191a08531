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

/// Two triangles (x_0, x_1, x_2) and (x_1, x_0, x_3), of which neither is flat.
struct Hinge {
  Vector3d e, arm[2], n[2];  ///< x_1 - x_0; x_2 - x_0, x_3 - x_0; outward normals, twice the areas long
  double length, q[2];       ///< |e|, |n|^2
};

std::optional<Hinge> hinge_at(const Eigen::Vector4i& hinge, const Matrix3Xd& x) {
  const Vector3d x0 = x.col(hinge[0]);
  Hinge at;
  at.e = x.col(hinge[1]) - x0;
  for (int side = 0; side < 2; ++side) at.arm[side] = x.col(hinge[2 + side]) - x0;
  at.n[0] = at.e.cross(at.arm[0]);
  at.n[1] = at.arm[1].cross(at.e);
  at.length = at.e.norm();
  for (int side = 0; side < 2; ++side) at.q[side] = at.n[side].squaredNorm();
  if (!(at.length > 0 && at.q[0] > 0 && at.q[1] > 0)) return {};
  return at;
}

/// Dihedral [Bridson et al. 2003].
double angle_of(const Hinge& at) {
  return std::atan2(at.n[0].cross(at.n[1]).dot(at.e) / at.length, at.n[0].dot(at.n[1]));
}

/// Of the dihedral, by x_0 ... x_3 (1/m).
Gradient gradient_of(const Hinge& at) {
  const Vector3d g2 = -at.length / at.q[0] * at.n[0], g3 = -at.length / at.q[1] * at.n[1];
  const double squared = at.length * at.length, t2 = at.arm[0].dot(at.e) / squared,
               t3 = at.arm[1].dot(at.e) / squared;
  Gradient gradient;
  gradient << -(1 - t2) * g2 - (1 - t3) * g3, -t2 * g2 - t3 * g3, g2, g3;
  return gradient;
}

/// Multiplies an angle and its gradient, if that is asked for, by t (2 - t) where the triangle of a side has
/// shrunk to t < 1 times `least`: unbounded, the gradient would go with one over its height.
void fade(const Hinge& at, int side, double least, double& angle, Gradient* gradient) {
  if (at.q[side] >= 4 * least * least) return;
  const double area = std::sqrt(at.q[side]) / 2, t = area / least;
  if (gradient) {
    *gradient *= t * (2 - t);
    const Vector3d slope = angle * 2 * (1 - t) / least / (4 * area) * (side == 0 ? 1 : -1) * at.n[side];
    gradient->col(0) += (at.e - at.arm[side]).cross(slope);
    gradient->col(1) += at.arm[side].cross(slope);
    gradient->col(2 + side) -= at.e.cross(slope);
  }
  angle *= t * (2 - t);
}

/// theta - theta_0 of a hinge, in (-pi, pi], faded, and its gradient if that is asked for.
double bent_by(const Bending& bending, int b, const Hinge& at, Gradient* gradient = nullptr) {
  double angle = angle_of(at) - bending.rest_angle[b];
  if (angle > M_PI) angle -= 2 * M_PI;
  if (angle <= -M_PI) angle += 2 * M_PI;
  if (gradient) *gradient = gradient_of(at);
  for (int side = 0; side < 2; ++side) fade(at, side, kCrumpled * bending.area(side, b), angle, gradient);
  return angle;
}

/// Calls visit(hinge number, stiffness, theta - theta_0 faded, its gradient).
template <class Visit>
void for_each_hinge(const Bending& bending, const Matrix3Xd& x, const Visit& visit) {
  for (int b = 0; b < bending.hinges.cols(); ++b) {
    const auto at = hinge_at(bending.hinges.col(b), x);
    if (!at) continue;
    Gradient gradient;
    const double angle = bent_by(bending, b, *at, &gradient);
    visit(b, bending.stiffness[b], angle, gradient);
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
    const auto at = hinge_at(hinge, X);
    bending.hinges.col(b) = hinge;
    bending.rest_angle[b] = at ? angle_of(*at) : 0;
    bending.stiffness[b] = at ? k_b * e.squaredNorm() / bending.area.col(b).sum() : 0;
  }
  return bending;
}

Bending part_of(const Bending& bending, const std::vector<int>& hinges) {
  return {bending.hinges(Eigen::all, hinges), bending.area(Eigen::all, hinges), bending.rest_angle(hinges),
          bending.stiffness(hinges)};
}

double energy(const Bending& bending, const Matrix3Xd& x) {
  double sum = 0;
  for (int b = 0; b < bending.hinges.cols(); ++b)
    if (const auto at = hinge_at(bending.hinges.col(b), x)) {
      const double angle = bent_by(bending, b, *at);
      sum += bending.stiffness[b] / 2 * angle * angle;
    }
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
        if (const int i = bending.hinges(c, b), j = bending.hinges(d, b); i <= j)
          K.block[K.find(i, j)] += k * gradient.col(c) * gradient.col(d).transpose();
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
           const Matrix3Xd& x, Eigen::Ref<Eigen::VectorXd> rest_length, const LargestOf& largest_of) {
  const Eigen::VectorXd f = mean_bending_forces(bending, x);
  const double largest = largest_of ? largest_of(f) : f.maxCoeff();
  if (!(largest > 0)) return;
  for (Eigen::Index s = 0; s < E.cols(); ++s)
    rest_length(s) *= std::pow(1 - coefficient * (f(E(0, s)) + f(E(1, s))) / (2 * largest), h);
}

}  // namespace testbed::meshing
