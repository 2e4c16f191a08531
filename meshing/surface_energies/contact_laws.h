// Barrier and friction of a pair in contact, as functions of its gap and of its slip [Li et al. 2020].
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace testbed::meshing {

struct BarrierValue {
  double b, db, ddb;
};

/// b(d) = -(d - range)^2 ln(d/range) for 0 < d < range (m2), and its derivatives by d [(26)].
inline BarrierValue barrier_at(double d, double range) {
  const double e = d - range, q = std::log(d / range);
  return {-e * e * q, -2 * e * q - e * e / d, -2 * q - 4 * e / d + e * e / (d * d)};
}

/// The length s (m) that friction acts along, smoothed below `slip`:
/// its value, s over its derivative by s, and the derivative of that.
struct SmoothLength {
  double value, norm, dnorm;
};

inline SmoothLength smooth_length(double s, double slip) {
  const double q = s / slip;
  if (q >= 1) return {s, s, 1};
  return {slip * (q * q * (1 - q / 3) + 1. / 3), slip / (2 - q), 1 / ((2 - q) * (2 - q))};
}

inline Eigen::Vector3d direction(const Eigen::Vector3d& v) {
  const double length = v.norm();
  return length > 0 ? Eigen::Vector3d(v / length) : Eigen::Vector3d::Zero();
}

inline Eigen::Vector3d no_longer_than(double limit, const Eigen::Vector3d& v) {
  const double length = v.norm();
  return length > limit ? Eigen::Vector3d(limit / length * v) : v;
}

constexpr double kStiff = 1. / 50;   ///< kappa times the range, over Young's modulus
constexpr double kStillSpeed = 0.1;  ///< ranges per second that are no motion

/// Of norm * friction = limit * way by x, the symmetric part (N); at least zero where |friction| <= limit.
/// @param friction  that the point exerts, as foreseen (N)
inline Eigen::Matrix3d friction_hessian(double limit, const Eigen::Vector3d& normal,
                                        const Eigen::Vector3d& friction, const Eigen::Vector3d& way,
                                        double slip) {
  const SmoothLength length = smooth_length(way.norm(), slip);
  const Eigen::Matrix3d turned = friction * direction(way).transpose();
  return limit / length.norm * (Eigen::Matrix3d::Identity() - normal * normal.transpose()) -
         length.dnorm / (2 * length.norm) * (turned + turned.transpose());
}

/// Friction (N) at slip `way` as the Hessian at slip `before` foresees it.
inline Eigen::Vector3d friction_foreseen(double limit, const Eigen::Vector3d& friction,
                                         const Eigen::Vector3d& before, const Eigen::Vector3d& way,
                                         double slip) {
  const SmoothLength length = smooth_length(before.norm(), slip);
  const double grown = length.dnorm * direction(before).dot(way - before);
  return no_longer_than(limit, (limit * way - grown * friction) / length.norm);
}

}  // namespace testbed::meshing
