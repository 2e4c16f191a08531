#include "meshing/surface_energies/barrier.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "meshing/surface_energies/surface_points.h"

namespace testbed::meshing {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

namespace {

struct BarrierValue {
  double b, db, ddb;
};

BarrierValue barrier_at(double d, double range) {
  const double e = d - range, q = std::log(d / range);
  return {-e * e * q, -2 * e * q - e * e / d, -2 * q - 4 * e / d + e * e / (d * d)};
}

/// The length s (m) that friction acts along, smoothed below `slip`:
/// its value, s over its derivative by s, and the derivative of that.
struct SmoothLength {
  double value, norm, dnorm;
};

SmoothLength smooth_length(double s, double slip) {
  const double q = s / slip;
  if (q >= 1) return {s, s, 1};
  return {slip * (q * q * (1 - q / 3) + 1. / 3), slip / (2 - q), 1 / ((2 - q) * (2 - q))};
}

Vector3d direction(const Vector3d& v) {
  const double length = v.norm();
  return length > 0 ? Vector3d(v / length) : Vector3d::Zero();
}

constexpr double kClosest = 1e-3;    // of the range: where ways end that would go in
constexpr double kFirst = 0.5;       // of the range: the first guess of a new contact's gap
constexpr double kStillSpeed = 0.1;  // ranges per second that are no motion

}  // namespace

Vector3d Barrier::slid(const Held& held, const Matrix3Xd& x) const {
  const Vector3d way = x.col(held.point) - held.start;
  return way - held.normal.dot(way) * held.normal;
}

template <class Visit>
void Barrier::for_each_near(const Matrix3Xd& x, const Visit& visit) const {
  for (const RigidBody& body : bodies_)
    for (int i = 0; i < weights_.size(); ++i)
      if (const RigidBody::Gap gap = body.gap(x.col(i), t_); gap.distance < range_) visit(i, gap);
}

void Barrier::begin_step(double t, double h, const Matrix3Xd& x) {
  held_.clear();
  slip_ = kStillSpeed * range_ * h;
  for (size_t b = 0; b < bodies_.size(); ++b) {
    if (bodies_[b].friction == 0) continue;
    const Vector3d shift = bodies_[b].translation(t + h) - bodies_[b].translation(t);
    for (int i = 0; i < weights_.size(); ++i) {
      const RigidBody::Gap gap = bodies_[b].gap(x.col(i), t);
      if (gap.distance <= 0 || gap.distance >= range_) continue;
      const double force = -kappa_ * weights_(i) * barrier_at(gap.distance, range_).db;
      held_.push_back({i, gap.normal, x.col(i) + shift, bodies_[b].friction * force, Vector3d::Zero()});
    }
  }
  t_before_ = t;
  t_ = t + h;
}

bool Barrier::keep_out(const Matrix3Xd& x, Matrix3Xd& y) const {
  bool is_moved = false;
  for (const RigidBody& body : bodies_)
    for (int i = 0; i < weights_.size(); ++i) {
      Vector3d yi = y.col(i);
      if (const auto touch = body.first_touch(x.col(i), yi, t_, 0, kClosest * range_)) yi = *touch;
      // Newton's method doubles a gap that is far too small, so points in touch keep theirs.
      if (const RigidBody::Gap gap = body.gap(yi, t_); gap.distance < kFirst * range_) {
        const double before = body.gap(x.col(i), t_before_).distance;
        const double kept = std::clamp(before, kClosest * range_, kFirst * range_);
        if (gap.distance < kept) yi += (kept - gap.distance) * gap.normal;
      }
      is_moved |= yi != y.col(i);
      y.col(i) = yi;
    }
  return is_moved;
}

double Barrier::largest_step(const Matrix3Xd& x, const Matrix3Xd& dx) const {
  constexpr double kKept = 0.1;  // of the gap along the way
  double part = 1;
  for (const RigidBody& body : bodies_)
    for (int i = 0; i < weights_.size(); ++i) {
      const Vector3d xi = x.col(i);
      const double gap = body.gap(xi, t_).distance, length = dx.col(i).norm();
      if (gap > part * length) continue;
      if (const auto touch = body.first_touch(xi, xi + part * dx.col(i), t_, 0, kKept * gap))
        part = std::min(part, (*touch - xi).norm() / length);
    }
  return part;
}

double Barrier::energy(const Matrix3Xd& x) const {
  double sum = 0;
  for_each_near(x, [&](int i, const RigidBody::Gap& gap) {
    sum += gap.distance > 0 ? kappa_ * weights_(i) * barrier_at(gap.distance, range_).b
                            : std::numeric_limits<double>::infinity();
  });
  for (const Held& held : held_) sum += held.limit * smooth_length(slid(held, x).norm(), slip_).value;
  return sum;
}

void Barrier::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for_each_near(x, [&](int i, const RigidBody::Gap& gap) {
    f.col(i) -= kappa_ * weights_(i) * barrier_at(gap.distance, range_).db * gap.normal;
  });
  for (const Held& held : held_) {
    const Vector3d way = slid(held, x);
    f.col(held.point) -= held.limit / smooth_length(way.norm(), slip_).norm * way;
  }
}

void Barrier::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature) const {
  std::vector<Eigen::Matrix3d>& diagonal = H.diagonal;
  if (diagonal.empty()) diagonal.assign(x.cols(), Eigen::Matrix3d::Zero());
  for_each_near(x, [&](int i, const RigidBody::Gap& gap) {
    diagonal[i] +=
        kappa_ * weights_(i) * barrier_at(gap.distance, range_).ddb * gap.normal * gap.normal.transpose();
  });
  // Of norm * friction = limit * way by x, the symmetric part.
  for (const Held& held : held_) {
    const Vector3d way = slid(held, x);
    const SmoothLength length = smooth_length(way.norm(), slip_);
    const Eigen::Matrix3d turned = held.friction * direction(way).transpose();
    diagonal[held.point] +=
        held.limit / length.norm * (Eigen::Matrix3d::Identity() - held.normal * held.normal.transpose()) -
        length.dnorm / (2 * length.norm) * (turned + turned.transpose());
  }
}

void Barrier::follow(const Matrix3Xd& x, const Matrix3Xd& y) {
  for (Held& held : held_) {
    const Vector3d before = slid(held, x), way = slid(held, y);
    const SmoothLength length = smooth_length(before.norm(), slip_);
    const double grown = length.dnorm * direction(before).dot(way - before);
    held.friction = (held.limit * way - grown * held.friction) / length.norm;
    if (const double size = held.friction.norm(); size > held.limit) held.friction *= held.limit / size;
  }
}

std::shared_ptr<SurfaceEnergy> barrier_around(const std::vector<RigidBody>& bodies, const Matrix3Xd& X,
                                              const Eigen::MatrixXi& faces, double E,
                                              const std::vector<char>& is_constrained) {
  constexpr double kRange = 1e-3, kStiff = 1. / 50;
  const double range = kRange * (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).norm();
  WeightedPoints points = contact_points(faces, X, is_constrained);
  return std::make_shared<EnergyOfPoints>(
      std::make_shared<Barrier>(std::move(points.weights), range, kStiff * E / range, bodies), points.W);
}

}  // namespace testbed::meshing
