// Preconditioned conjugate gradients on node vectors and other fields.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <type_traits>

#include "meshing/algebra/single_precision.h"

namespace testbed::meshing {

struct SolveReport {
  int iterations = 0;
  double residual = 0;  ///< |b - A x| / |b|
  bool is_converged = false;
  double curvature = 0;  ///< p . A p / (|p| |A p|) of the search direction p that ended it, if one did
};

// What iterations do with fields of double precision; single_precision.h has those of single precision.

/// Over all entries.
template <class U, class W>
double dot(const Eigen::MatrixBase<U>& u, const Eigen::MatrixBase<W>& w) {
  return u.cwiseProduct(w).sum();
}

/// x += alpha p, r -= alpha Ap; r . r.
template <class Field>
typename Field::Scalar advance(typename Field::Scalar alpha, const Field& p, const Field& Ap, Field& x,
                               Field& r) {
  x += alpha * p;
  r -= alpha * Ap;
  return r.squaredNorm();
}

/// p = z + beta p.
template <class Field>
void aypx(typename Field::Scalar beta, const Field& z, Field& p) {
  p = z + beta * p;
}

/// y = A u; u . y, which some operators return, as they have both at hand.
template <class Operator, class Field>
double apply(const Operator& A, const Field& u, Field& y) {
  if constexpr (std::is_void_v<std::invoke_result_t<const Operator&, const Field&, Field&>>) {
    A(u, y);
    return dot(u, y);
  } else {
    return A(u, y);
  }
}

/// Solves A x = b for a symmetric positive semidefinite A and a right-hand side in its range, from the guess
/// in x [Hestenes & Stiefel 1952]. Fields need dot, advance and aypx.
/// @param product       (p, y): y = A p
/// @param precondition  (r, z): z = a symmetric positive definite approximation of A^-1 times r
/// @param r             b - A x of the guess; becomes that of the solution, as far as rounding lets it
/// @param size          that residuals are relative to, |b| or 1
/// @param in_energy     of sqrt(r . z) over the first one, which is near the error in energy: what is left of
/// soft motions, which the residual hardly shows. Seen one iteration late.
template <class Product, class Precondition, class Field>
SolveReport conjugate_gradients(const Product& product, const Precondition& precondition, Field& r,
                                double size, Field& x, double tolerance, int max_iterations,
                                double in_energy = std::numeric_limits<double>::infinity()) {
  using Scalar = typename Field::Scalar;
  SolveReport report;
  Field z, p, Ap;
  double rr = dot(r, r), rz_before = 0, rz_first = 0;
  while (true) {
    report.residual = std::sqrt(rr) / size;
    const bool is_left = rr > 0 && std::sqrt(rz_before) > in_energy * std::sqrt(rz_first);
    report.is_converged = report.residual <= tolerance && !is_left;
    if (report.is_converged || report.iterations == max_iterations) return report;
    const double rz = apply(precondition, r, z);
    if (report.iterations == 0) {
      p = z;
      rz_first = rz;
    } else {
      aypx(static_cast<Scalar>(rz / rz_before), z, p);
    }
    const double pAp = apply(product, p, Ap);
    if (!(pAp > 0 && rz > 0)) {  // p lies in the null space: nothing more to gain
      report.curvature = pAp / std::sqrt(dot(p, p) * dot(Ap, Ap));
      return report;
    }
    rr = advance(static_cast<Scalar>(rz / pAp), p, Ap, x, r);
    rz_before = rz;
    ++report.iterations;
  }
}

/// The same from a right-hand side, in double precision.
template <class Product, class Precondition>
SolveReport conjugate_gradients(const Product& product, const Precondition& precondition,
                                const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x, double tolerance,
                                int max_iterations) {
  const double b_norm = b.norm();
  Eigen::Matrix3Xd r;
  product(x, r);
  r = b - r;
  return conjugate_gradients(product, precondition, r, b_norm > 0 ? b_norm : 1, x, tolerance, max_iterations);
}

/// Bi-conjugate gradients for any regular A, by a product with A and one with its transpose in each iteration
/// [Fletcher 1976]. Where A is symmetric they take the steps of conjugate gradients at twice the cost.
/// @param transposed    as `product`, with A^T
/// @param precondition  symmetric
template <class Product, class Transposed, class Precondition>
SolveReport bi_conjugate_gradients(const Product& product, const Transposed& transposed,
                                   const Precondition& precondition, const Eigen::Matrix3Xd& b,
                                   Eigen::Matrix3Xd& x, double tolerance, int max_iterations) {
  SolveReport report;
  const double b_norm = b.norm();
  Eigen::Matrix3Xd r, z, p, Ap, shadow_z, shadow_p, shadow_Ap;
  product(x, Ap);
  r = b - Ap;
  Eigen::Matrix3Xd shadow = r;
  double rho = 0;
  while (true) {
    report.residual = b_norm > 0 ? r.norm() / b_norm : r.norm();
    report.is_converged = report.residual <= tolerance;
    if (report.is_converged || report.iterations == max_iterations) return report;
    precondition(r, z);
    precondition(shadow, shadow_z);
    const double rho_before = rho;
    rho = dot(z, shadow);
    const double beta = report.iterations > 0 ? rho / rho_before : 0;
    if (report.iterations == 0) {
      p = z;
      shadow_p = shadow_z;
    } else {
      p = z + beta * p;
      shadow_p = shadow_z + beta * shadow_p;
    }
    product(p, Ap);
    transposed(shadow_p, shadow_Ap);
    const double alpha = rho / dot(shadow_p, Ap);
    if (!std::isfinite(alpha) || !std::isfinite(beta)) return report;  // nothing left to gain
    x += alpha * p;
    r -= alpha * Ap;
    shadow -= alpha * shadow_Ap;
    ++report.iterations;
  }
}

/// Bi-conjugate gradients stabilised: two products with A in each iteration, and none with its transpose
/// [van der Vorst 1992].
template <class Product, class Precondition>
SolveReport stabilised_bi_conjugate_gradients(const Product& product, const Precondition& precondition,
                                              const Eigen::Matrix3Xd& b, Eigen::Matrix3Xd& x,
                                              double tolerance, int max_iterations) {
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

}  // namespace testbed::meshing
