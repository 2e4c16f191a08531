// Preconditioned conjugate gradients on node vectors.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace testbed::massspring {

struct SolveReport {
  int iterations = 0;
  double residual = 0;  ///< |b - A x| / |b|
  bool is_converged = false;
};

/// Solves A x = b for a symmetric positive semidefinite A and a right-hand side in its range, from the guess
/// in x [Hestenes & Stiefel 1952].
/// @param product       (p, y): y = A p
/// @param precondition  (r, z): z = a symmetric positive definite approximation of A^-1 times r
template <class Product, class Precondition>
SolveReport conjugate_gradients(const Product& product, const Precondition& precondition,
                                const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance,
                                int max_iterations) {
  const auto dot = [](const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& w) {
    return u.cwiseProduct(w).sum();
  };
  SolveReport report;
  const double b_norm = b.norm();
  Eigen::Matrix3Xd r, z, p, Ap;
  product(x, Ap);
  r = b - Ap;
  precondition(r, z);
  p = z;
  double rz = dot(r, z);
  while (true) {
    report.residual = b_norm > 0 ? r.norm() / b_norm : r.norm();
    report.is_converged = report.residual <= tolerance;
    if (report.is_converged || report.iterations == max_iterations) return report;
    product(p, Ap);
    const double pAp = dot(p, Ap);
    if (!(pAp > 0 && rz > 0)) return report;  // p lies in the null space: nothing more to gain
    const double alpha = rz / pAp;
    x += alpha * p;
    r -= alpha * Ap;
    precondition(r, z);
    const double rz_before = rz;
    rz = dot(r, z);
    p = z + rz / rz_before * p;
    ++report.iterations;
  }
}

/// The same for any regular A, in two products an iteration [van der Vorst 1992].
template <class Product, class Precondition>
SolveReport bi_conjugate_gradients(const Product& product, const Precondition& precondition,
                                   const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance,
                                   int max_iterations) {
  const auto dot = [](const Eigen::Matrix3Xd& u, const Eigen::Matrix3Xd& w) {
    return u.cwiseProduct(w).sum();
  };
  SolveReport report;
  const double b_norm = b.norm();
  Eigen::Matrix3Xd r, p, z, Az, Ap;
  product(x, Ap);
  r = p = b - Ap;
  const Eigen::Matrix3Xd shadow = r;
  double rho = dot(shadow, r);
  while (true) {
    report.residual = b_norm > 0 ? r.norm() / b_norm : r.norm();
    report.is_converged = report.residual <= tolerance;
    if (report.is_converged || report.iterations == max_iterations) return report;
    precondition(p, z);
    product(z, Ap);
    const double alpha = rho / dot(shadow, Ap);
    x += alpha * z;
    r -= alpha * Ap;
    precondition(r, z);
    product(z, Az);
    const double omega = dot(Az, r) / Az.squaredNorm();
    if (!std::isfinite(alpha) || !std::isfinite(omega)) return report;  // nothing left to gain
    x += omega * z;
    r -= omega * Az;
    const double rho_before = rho;
    rho = dot(shadow, r);
    p = r + rho / rho_before * alpha / omega * (p - omega * Ap);
    ++report.iterations;
  }
}

}  // namespace testbed::massspring
