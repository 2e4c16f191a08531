#include "meshing/surface_energies/bending.h"

#include <Eigen/Geometry>
#include <cmath>
#include <map>
#include <unsupported/Eigen/AutoDiff>

namespace testbed::meshing {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;
template <class T>
using Corners = Eigen::Matrix<T, 3, 4>;  // x_0 ... x_3, or something of each of them
using Matrix12 = Eigen::Matrix<double, 12, 12>;

constexpr double kCrumpled = 0.1;  // of a triangle's area at rest

/// Two triangles (x_0, x_1, x_2) and (x_1, x_0, x_3).
/// @tparam T  double, or such that also knows its derivatives
template <class T>
struct Hinge {
  using Vector = Eigen::Matrix<T, 3, 1>;
  Vector e, arm[2], n[2];  ///< x_1 - x_0; x_2 - x_0, x_3 - x_0; outward normals, twice the areas long
  T length, q[2];          ///< |e|, |n|^2

  explicit Hinge(const Corners<T>& x) : e(x.col(1) - x.col(0)) {
    for (int side = 0; side < 2; ++side) arm[side] = x.col(2 + side) - x.col(0);
    n[0] = e.cross(arm[0]);
    n[1] = arm[1].cross(e);
    length = e.norm();
    for (int side = 0; side < 2; ++side) q[side] = n[side].squaredNorm();
  }
  bool is_flat() const { return !(length > 0 && q[0] > 0 && q[1] > 0); }
};

/// Dihedral [Bridson et al. 2003].
template <class T>
T angle_of(const Hinge<T>& at) {
  const T sine = at.n[0].cross(at.n[1]).dot(at.e) / at.length, cosine = at.n[0].dot(at.n[1]);
  using std::atan2;
  return atan2(sine, cosine);
}

/// Of the dihedral, by x_0 ... x_3 (1/m).
template <class T>
Corners<T> gradient_of(const Hinge<T>& at) {
  const T squared = at.length * at.length;
  Corners<T> gradient = Corners<T>::Zero();
  for (int side = 0; side < 2; ++side) {
    const T part = at.arm[side].dot(at.e) / squared, rest = 1. - part, lever = -at.length / at.q[side];
    gradient.col(2 + side) = lever * at.n[side];
    gradient.col(0) -= rest * gradient.col(2 + side);
    gradient.col(1) -= part * gradient.col(2 + side);
  }
  return gradient;
}

/// Multiplies an angle and its gradient, if that is asked for, by t (2 - t) where the triangle of a side has
/// shrunk to t < 1 times `least`: unbounded, the gradient would go with one over its height.
template <class T>
void fade(const Hinge<T>& at, int side, double least, T& angle, Corners<T>* gradient) {
  if (at.q[side] >= 4 * least * least) return;
  using std::sqrt;
  const T area = sqrt(at.q[side]) / 2., t = area / least, counted = t * (2. - t);
  if (gradient) {
    *gradient *= counted;
    const T by_area = angle * (1. - t) / (2 * least * area);
    const typename Hinge<T>::Vector slope = (side == 0 ? by_area : T(-by_area)) * at.n[side];
    gradient->col(0) += (at.e - at.arm[side]).cross(slope);
    gradient->col(1) += at.arm[side].cross(slope);
    gradient->col(2 + side) -= at.e.cross(slope);
  }
  angle *= counted;
}

/// theta - theta_0 of a hinge, in (-pi, pi], faded, and its gradient if that is asked for.
template <class T>
T bent_by(const Bending& bending, int b, const Hinge<T>& at, Corners<T>* gradient = nullptr) {
  T angle = angle_of(at) - bending.rest_angle[b];
  if (angle > M_PI) angle -= 2 * M_PI;
  if (angle <= -M_PI) angle += 2 * M_PI;
  if (gradient) *gradient = gradient_of(at);
  for (int side = 0; side < 2; ++side) fade(at, side, kCrumpled * bending.area(side, b), angle, gradient);
  return angle;
}

/// Calls visit(hinge number, corners, hinge) where no triangle is flat.
template <class Visit>
void for_each_hinge(const Bending& bending, const Matrix3Xd& x, const Visit& visit) {
  for (int b = 0; b < bending.hinges.cols(); ++b) {
    const Corners<double> corners = x(Eigen::all, bending.hinges.col(b));
    if (const Hinge<double> at(corners); !at.is_flat()) visit(b, corners, at);
  }
}

/// By x_0 ... x_3, of the hinge that they make.
Matrix12 hessian_of(const Bending& bending, int b, const Corners<double>& x, const Hinge<double>& at,
                    Curvature curvature) {
  if (curvature != Curvature::Exact) {
    Corners<double> gradient;
    bent_by(bending, b, at, &gradient);
    return bending.stiffness[b] * gradient.reshaped() * gradient.reshaped().transpose();
  }
  using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, 12, 1>>;
  Corners<Dual> dual, gradient;
  for (int k = 0; k < 12; ++k) dual(k) = Dual(x(k), 12, k);
  const Dual angle = bent_by(bending, b, Hinge<Dual>(dual), &gradient);
  Matrix12 H;
  for (int k = 0; k < 12; ++k)
    H.col(k) = bending.stiffness[b] *
               (gradient(k).value() * angle.derivatives() + angle.value() * gradient(k).derivatives());
  return H;
}

/// Calls visit(stiffness times theta - theta_0 faded, gradient, nodes): what pushes the nodes of each hinge.
template <class Visit>
void for_each_torque(const Bending& bending, const Matrix3Xd& x, const Visit& visit) {
  for_each_hinge(bending, x, [&](int b, const Corners<double>&, const Hinge<double>& at) {
    Corners<double> gradient;
    const double angle = bent_by(bending, b, at, &gradient);
    visit(bending.stiffness[b] * angle, gradient, bending.hinges.col(b));
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
    const Hinge<double> at(X(Eigen::all, hinge));
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
  for_each_hinge(bending, x, [&](int b, const Corners<double>&, const Hinge<double>& at) {
    const double angle = bent_by(bending, b, at);
    sum += bending.stiffness[b] / 2 * angle * angle;
  });
  return sum;
}

void add_forces(const Bending& bending, const Matrix3Xd& x, Matrix3Xd& f) {
  for_each_torque(bending, x,
                  [&](double torque, const Corners<double>& gradient, const Eigen::Vector4i& nodes) {
                    for (int c = 0; c < 4; ++c) f.col(nodes[c]) -= torque * gradient.col(c);
                  });
}

void add_hessian(const Bending& bending, const Matrix3Xd& x, BlockMatrix& K, Curvature curvature) {
  for_each_hinge(bending, x, [&](int b, const Corners<double>& corners, const Hinge<double>& at) {
    const Matrix12 H = hessian_of(bending, b, corners, at, curvature);
    for (int c = 0; c < 4; ++c)
      for (int d = 0; d < 4; ++d)
        if (const int i = bending.hinges(c, b), j = bending.hinges(d, b); i <= j)
          K.block[K.find(i, j)] += H.block<3, 3>(3 * c, 3 * d);
  });
}

void add_hessian(const Bending& bending, const Matrix3Xd& x, SurfaceHessian& sum, Curvature curvature) {
  for_each_hinge(bending, x, [&](int b, const Corners<double>& corners, const Hinge<double>& at) {
    const Matrix12 H = hessian_of(bending, b, corners, at, curvature);
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
  for_each_torque(bending, x,
                  [&](double torque, const Corners<double>& gradient, const Eigen::Vector4i& nodes) {
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
