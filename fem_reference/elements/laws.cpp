#include "fem_reference/elements/laws.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>

namespace testbed::fem {
namespace {

using Eigen::Matrix3d;

Matrix3d isotropic(const LameConstants& lame, const Matrix3d& strain) {
  return lame.lambda * strain.trace() * Matrix3d::Identity() + 2 * lame.mu * strain;
}

double isotropic_energy(const LameConstants& lame, const Matrix3d& strain) {
  return lame.lambda / 2 * strain.trace() * strain.trace() + lame.mu * strain.squaredNorm();
}

/// Fills C from the derivative of P in the direction dF.
template <class Derivative>
void fill_tangent(ElasticResponse& r, Derivative derivative) {
  for (int k = 0; k < 9; ++k) {
    Matrix3d dF = Matrix3d::Zero();
    dF(k) = 1;
    const Matrix3d dP = derivative(dF);
    r.C.col(k) = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(dP.data());
  }
}

Matrix3d symmetric(const Matrix3d& A) {
  return (A + A.transpose()) / 2;
}

ElasticResponse small_strain(const LameConstants& lame, const Matrix3d& F, bool with_tangent) {
  const Matrix3d strain = symmetric(F) - Matrix3d::Identity();
  ElasticResponse r{isotropic_energy(lame, strain), isotropic(lame, strain), {}};
  if (with_tangent) fill_tangent(r, [&](const Matrix3d& dF) { return isotropic(lame, symmetric(dF)); });
  return r;
}

ElasticResponse st_venant_kirchhoff(const LameConstants& lame, const Matrix3d& F, bool with_tangent) {
  const Matrix3d strain = (F.transpose() * F - Matrix3d::Identity()) / 2, S = isotropic(lame, strain);
  ElasticResponse r{isotropic_energy(lame, strain), F * S, {}};
  if (with_tangent)
    fill_tangent(r, [&](const Matrix3d& dF) -> Matrix3d {
      return dF * S + F * isotropic(lame, symmetric(F.transpose() * dF));
    });
  return r;
}

ElasticResponse neo_hookean(const LameConstants& lame, const Matrix3d& F, bool with_tangent) {
  const double J = F.determinant();
  if (J <= 0) return {std::numeric_limits<double>::infinity(), Matrix3d::Zero(), {}};
  const Matrix3d G = F.inverse().transpose();
  const double a = lame.lambda / 2 * (J * J - 1) - lame.mu;  // J g'(J); -mu exactly at rest
  ElasticResponse r{lame.mu / 2 * (F.squaredNorm() - 3) + lame.lambda / 4 * (J * J - 1) -
                        (lame.mu + lame.lambda / 2) * std::log(J),
                    lame.mu * F + a * G,
                    {}};
  if (with_tangent)
    fill_tangent(r, [&](const Matrix3d& dF) -> Matrix3d {
      return lame.mu * dF + lame.lambda * J * J * G.cwiseProduct(dF).sum() * G - a * G * dF.transpose() * G;
    });
  return r;
}

}  // namespace

LameConstants::LameConstants(const Material& m)
    : lambda(m.E * m.nu / ((1 + m.nu) * (1 - 2 * m.nu))), mu(m.E / (2 * (1 + m.nu))) {}

ElasticResponse respond(ElasticLaw law, const LameConstants& lame, const Matrix3d& F, double s,
                        bool with_tangent) {
  if (law == ElasticLaw::SmallStrain) return small_strain(lame, F + s * Matrix3d::Identity(), with_tangent);
  const double c = 1 - s;
  ElasticResponse r = law == ElasticLaw::NeoHookean ? neo_hookean(lame, F / c, with_tangent)
                                                    : st_venant_kirchhoff(lame, F / c, with_tangent);
  r.energy *= c * c * c;
  r.P *= c * c;
  if (with_tangent) r.C *= c;
  return r;
}

}  // namespace testbed::fem
