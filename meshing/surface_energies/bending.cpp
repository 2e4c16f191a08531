#include "meshing/surface_energies/bending.h"

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <map>

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Corners = Eigen::Matrix<double, 3, 4>;  // x_0 ... x_3, or something of each of them
using Matrix9 = Eigen::Matrix<double, 9, 9>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;

constexpr double kCrumpled = 0.1;  // of a triangle's area at rest

/// Two triangles (x_0, x_1, x_2) and (x_1, x_0, x_3). Gradients (in columns) and Hessians are by e, by the first arm
/// and by the second.
struct Hinge {
  Vector3d e, arm[2], n[2];  ///< x_1 - x_0; x_2 - x_0, x_3 - x_0; outward normals, twice the areas long
  double squared, q[2];      ///< |e|^2, |n|^2

  explicit Hinge(const Corners& x) : e(x.col(1) - x.col(0)) {
    for (int side = 0; side < 2; ++side) arm[side] = x.col(2 + side) - x.col(0);
    n[0] = e.cross(arm[0]);
    n[1] = arm[1].cross(e);
    squared = e.squaredNorm();
    for (int side = 0; side < 2; ++side) q[side] = n[side].squaredNorm();
  }
  bool is_flat() const { return !(squared > 0 && q[0] > 0 && q[1] > 0); }
  double part(int side) const { return arm[side].dot(e) / squared; }  ///< of e, below the triangle's apex
};

Corners gradient_at_corners(const Matrix3d& gradient) {
  Corners all;
  all << -gradient.rowwise().sum(), gradient;
  return all;
}

Matrix12 hessian_at_corners(const Matrix9& hessian) {
  Eigen::Matrix<double, 12, 9> rows;
  rows.bottomRows<9>() = hessian;
  rows.topRows<3>() = -(hessian.topRows<3>() + hessian.middleRows<3>(3) + hessian.bottomRows<3>());
  Matrix12 all;
  all.rightCols<9>() = rows;
  all.leftCols<3>() = -(rows.leftCols<3>() + rows.middleCols<3>(3) + rows.rightCols<3>());
  return all;
}

Matrix3d symmetric(const Vector3d& a, const Vector3d& b) {
  const Matrix3d product = a * b.transpose();
  return product + product.transpose();
}

/// Dihedral [Bridson et al. 2003].
double angle_of(const Hinge& at) {
  return std::atan2(at.n[0].cross(at.n[1]).dot(at.e) / std::sqrt(at.squared), at.n[0].dot(at.n[1]));
}

/// Of the dihedral (1/m).
Matrix3d gradient_of_angle(const Hinge& at) {
  Matrix3d gradient = Matrix3d::Zero();
  for (int side = 0; side < 2; ++side) {
    gradient.col(1 + side) = -std::sqrt(at.squared) / at.q[side] * at.n[side];
    gradient.col(0) -= at.part(side) * gradient.col(1 + side);
  }
  return gradient;
}

/// Of the dihedral with that gradient [Tamstorf & Grinspun 2013] (1/m2).
Matrix9 hessian_of_angle(const Hinge& at, const Matrix3d& gradient) {
  Matrix9 H = Matrix9::Zero();
  for (int side = 0; side < 2; ++side) {
    const int k = 3 + 3 * side;
    const double part = at.part(side);
    const Vector3d v = gradient.col(1 + side), height = at.arm[side] - part * at.e;
    const Matrix3d twist = symmetric(v, height), by_arm = -at.squared / at.q[side] * twist;
    H.block<3, 3>(k, k) = by_arm;
    H.block<3, 3>(k, 0) = -at.e * v.transpose() / at.squared - part * by_arm;
    H.block<3, 3>(0, k) = H.block<3, 3>(k, 0).transpose();
    H.topLeftCorner<3, 3>() += (part * symmetric(v, at.e) - twist / 2) / at.squared + part * part * by_arm;
  }
  return H;
}

/// Of q[side] (m3 and m2).
Matrix3d gradient_of_q(const Hinge& at, int side) {
  const Vector3d& a = at.arm[side];
  const double dot = a.dot(at.e);
  Matrix3d gradient = Matrix3d::Zero();
  gradient.col(0) = 2 * (a.squaredNorm() * at.e - dot * a);
  gradient.col(1 + side) = 2 * (at.squared * a - dot * at.e);
  return gradient;
}
Matrix9 hessian_of_q(const Hinge& at, int side) {
  const int k = 3 + 3 * side;
  const Vector3d& a = at.arm[side];
  Matrix9 H = Matrix9::Zero();
  H.topLeftCorner<3, 3>() = 2 * (a.squaredNorm() * Matrix3d::Identity() - a * a.transpose());
  H.block<3, 3>(k, k) = 2 * (at.squared * Matrix3d::Identity() - at.e * at.e.transpose());
  H.block<3, 3>(0, k) =
      4 * at.e * a.transpose() - 2 * a * at.e.transpose() - 2 * a.dot(at.e) * Matrix3d::Identity();
  H.block<3, 3>(k, 0) = H.block<3, 3>(0, k).transpose();
  return H;
}

/// t (2 - t) where the triangle of a side has shrunk to t < 1 times `least`, else 1: what multiplies the angle, whose
/// gradient would go with one over the triangle's height.
struct Fading {
  double value = 1, slope = 0, curvature = 0;  ///< and its derivatives by q

  Fading(double q, double least) {
    if (q >= 4 * least * least) return;
    const double t = std::sqrt(q) / (2 * least);
    value = t * (2 - t);
    slope = t * (1 - t) / q;
    curvature = -t / (2 * q * q);
  }
};

/// theta - theta_0 of a hinge, in (-pi, pi], and how both sides fade it.
struct Bend {
  double angle;
  std::array<Fading, 2> fading;

  Bend(const Bending& bending, int b, const Hinge& at)
      : angle(angle_of(at) - bending.rest_angle[b]),
        fading{Fading(at.q[0], kCrumpled * bending.area(0, b)),
               Fading(at.q[1], kCrumpled * bending.area(1, b))} {
    if (angle > M_PI) angle -= 2 * M_PI;
    if (angle <= -M_PI) angle += 2 * M_PI;
  }
  double kept() const { return fading[0].value * fading[1].value; }
  double counted() const { return angle * kept(); }

  Matrix3d gradient(const Hinge& at) const {
    Matrix3d sum = kept() * gradient_of_angle(at);
    for (int side = 0; side < 2; ++side)
      if (fading[side].value < 1)
        sum += angle * fading[1 - side].value * fading[side].slope * gradient_of_q(at, side);
    return sum;
  }

  Matrix9 hessian(const Hinge& at) const {
    const Matrix3d by_angle = gradient_of_angle(at);
    Matrix9 sum = kept() * hessian_of_angle(at, by_angle);
    if (kept() == 1) return sum;
    const Matrix3d by_q[2] = {gradient_of_q(at, 0), gradient_of_q(at, 1)};
    const auto add = [&](double factor, const Matrix3d& a, const Matrix3d& b) {
      const Matrix9 product = factor * a.reshaped() * b.reshaped().transpose();
      sum += product + product.transpose();
    };
    for (int side = 0; side < 2; ++side) {
      const double other = fading[1 - side].value;
      add(other * fading[side].slope, by_angle, by_q[side]);
      add(angle * other * fading[side].curvature / 2, by_q[side], by_q[side]);
      sum += angle * other * fading[side].slope * hessian_of_q(at, side);
    }
    add(angle * fading[0].slope * fading[1].slope, by_q[0], by_q[1]);
    return sum;
  }
};

/// Calls visit(hinge number, hinge, how it is bent) where no triangle is flat.
template <class Visit>
void for_each_hinge(const Bending& bending, const Matrix3Xd& x, const Visit& visit) {
  for (int b = 0; b < bending.hinges.cols(); ++b)
    if (const Hinge at(x(Eigen::all, bending.hinges.col(b))); !at.is_flat())
      visit(b, at, Bend(bending, b, at));
}

/// Calls visit(hinge number, Hessian of its energy by x_0 ... x_3).
template <class Visit>
void for_each_hessian(const Bending& bending, const Matrix3Xd& x, Curvature curvature, const Visit& visit) {
  for_each_hinge(bending, x, [&](int b, const Hinge& at, const Bend& bend) {
    const Matrix3d gradient = bend.gradient(at);
    Matrix9 H = gradient.reshaped() * gradient.reshaped().transpose();
    if (curvature == Curvature::Exact) H += bend.counted() * bend.hessian(at);
    visit(b, hessian_at_corners(bending.stiffness[b] * H));
  });
}

/// Calls visit(stiffness times theta - theta_0 faded, gradient, nodes): what pushes the nodes of each hinge.
template <class Visit>
void for_each_torque(const Bending& bending, const Matrix3Xd& x, const Visit& visit) {
  for_each_hinge(bending, x, [&](int b, const Hinge& at, const Bend& bend) {
    visit(bending.stiffness[b] * bend.counted(), gradient_at_corners(bend.gradient(at)),
          bending.hinges.col(b));
  });
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
    const Hinge at(X(Eigen::all, hinge));
    bending.hinges.col(b) = hinge;
    bending.rest_angle[b] = at.is_flat() ? 0 : angle_of(at);
    bending.stiffness[b] = at.is_flat() ? 0 : k_b * e.squaredNorm() / bending.area.col(b).sum();
  }
  return bending;
}

Bending part_of(const Bending& bending, const std::vector<int>& hinges) {
  return {bending.hinges(Eigen::all, hinges), bending.area(Eigen::all, hinges), bending.rest_angle(hinges),
          bending.stiffness(hinges)};
}

double energy(const Bending& bending, const Matrix3Xd& x) {
  double sum = 0;
  for_each_hinge(bending, x, [&](int b, const Hinge&, const Bend& bend) {
    sum += bending.stiffness[b] / 2 * bend.counted() * bend.counted();
  });
  return sum;
}

void add_forces(const Bending& bending, const Matrix3Xd& x, Matrix3Xd& f) {
  for_each_torque(bending, x, [&](double torque, const Corners& gradient, const Eigen::Vector4i& nodes) {
    for (int c = 0; c < 4; ++c) f.col(nodes[c]) -= torque * gradient.col(c);
  });
}

void add_hessian(const Bending& bending, const Matrix3Xd& x, BlockMatrix& K, Curvature curvature) {
  for_each_hessian(bending, x, curvature, [&](int b, const Matrix12& H) {
    for (int c = 0; c < 4; ++c)
      for (int d = 0; d < 4; ++d)
        if (const int i = bending.hinges(c, b), j = bending.hinges(d, b); i <= j)
          K.block[K.find(i, j)] += H.block<3, 3>(3 * c, 3 * d);
  });
}

void add_hessian(const Bending& bending, const Matrix3Xd& x, SurfaceHessian& sum, Curvature curvature) {
  for_each_hessian(bending, x, curvature, [&](int b, const Matrix12& H) {
    for (int c = 0; c < 4; ++c)
      for (int d = c; d < 4; ++d)
        sum.blocks.push_back({bending.hinges(c, b), bending.hinges(d, b), H.block<3, 3>(3 * c, 3 * d)});
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
  for_each_torque(bending, x, [&](double torque, const Corners& gradient, const Eigen::Vector4i& nodes) {
    for (int c = 0; c < 2; ++c) {
      sum[nodes[c]] += std::abs(torque) * gradient.col(c).norm();
      ++count[nodes[c]];
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
