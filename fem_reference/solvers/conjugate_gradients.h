// Conjugate gradients on vectors of which each process holds a part. Internal to the library.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <utility>

#include "fem_reference/base/processes.h"
#include "fem_reference/solvers/two_level.h"

namespace testbed::fem {

inline double dot(const Eigen::VectorXd& u, const Eigen::VectorXd& v) {
  double product = u.dot(v);
  sum_over_processes(Eigen::Map<Eigen::VectorXd>(&product, 1));
  return product;
}

/// v less its components along orthonormal columns.
inline Eigen::VectorXd without(const Eigen::MatrixXd& columns, const Eigen::VectorXd& v) {
  if (columns.cols() == 0) return v;
  Eigen::VectorXd components = columns.transpose() * v;
  sum_over_processes(components);
  return v - columns * components;
}

/// Solves K x = b in the space orthogonal to `rigid`, which a tangent
/// out of balance does not take to zero [Hestenes & Stiefel 1952].
/// @param product       (p, Kp): Kp = K p
/// @param precondition  (r): a symmetric positive definite approximation of K^-1 times r
/// @param K_norm  Frobenius norm of K
template <class Product, class Precondition>
LinearReport conjugate_gradients(const Product& product, const Precondition& precondition, double K_norm,
                                 const Eigen::MatrixXd& rigid, const Eigen::VectorXd& b, double tolerance,
                                 int max_iterations) {
  LinearReport report;
  report.x = Eigen::VectorXd::Zero(b.size());
  Eigen::VectorXd r = b, z = without(rigid, precondition(r)), p = z, Kp(b.size());
  const double size = std::sqrt(dot(b, b));
  double rz = dot(r, z), r_norm = size;
  while (r_norm > tolerance * size && report.iterations < max_iterations) {
    product(p, Kp);
    Kp = without(rigid, Kp);
    const double curvature = dot(p, Kp);
    report.is_definite = curvature > 0;
    if (!report.is_definite) break;
    const double alpha = rz / curvature;
    report.x += alpha * p;
    r -= alpha * Kp;
    r_norm = std::sqrt(dot(r, r));
    z = without(rigid, precondition(r));
    const double rz_before = std::exchange(rz, dot(r, z));
    p = z + rz / rz_before * p;
    ++report.iterations;
  }
  report.residual = size > 0 ? r_norm / size : 0;
  // No solver does better than the rounding of its products [Rigal & Gaches 1967].
  const double rounding =
      std::numeric_limits<double>::epsilon() * K_norm * std::sqrt(dot(report.x, report.x));
  report.is_converged = report.residual <= tolerance || r_norm <= rounding;
  return report;
}

}  // namespace testbed::fem
