// Linear vibrations: natural frequencies and steps in time, on assembled matrices.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <memory>
#include <vector>

namespace testbed {

/// The lowest undamped modes, K x = w^2 M x.
struct Modes {
  Eigen::VectorXd frequency;  ///< Hz, ascending; 0 for rigid motions
  Eigen::MatrixXd shape;      ///< a column each, M-orthonormal (1/sqrt(kg))
  int n_rigid = 0;            ///< how many of them are rigid motions
};

/// The n lowest modes by Lanczos iteration on (K + s M)^-1, s > 0 small, so that free bodies are no
/// exception. K may be singular, M must be positive definite; the unknowns `held` (ascending) stay where they
/// are.
/// @throws std::runtime_error when it does not converge.
Modes natural_modes(const Eigen::SparseMatrix<double>& K, const Eigen::SparseMatrix<double>& M,
                    const std::vector<int>& held, int n);

/// Parameters of the generalised-alpha method [Chung & Hulbert 1993].
struct TimeScheme {
  double alpha_m, alpha_f, beta, gamma;
};
/// Average acceleration [Newmark 1959]: conserves energy of undamped motion exactly.
constexpr TimeScheme newmark{0, 0, 0.25, 0.5};
/// Second order; `rho`, in [0, 1], is what is left per step of the highest frequencies.
constexpr TimeScheme generalised_alpha(double rho) {
  const double alpha_m = (2 * rho - 1) / (rho + 1), alpha_f = rho / (rho + 1), d = 1 - alpha_m + alpha_f;
  return {alpha_m, alpha_f, d * d / 4, 0.5 - alpha_m + alpha_f};
}

struct LinearDynamics {
  Eigen::SparseMatrix<double> K, M;  ///< N/m, kg
  double damping = 0;                ///< 1/s: force -damping M v
  double stiffness_damping = 0;      ///< s: force -stiffness_damping K v
  Eigen::VectorXd load;              ///< N, constant in time
  std::vector<int> held;             ///< unknowns that move at a constant velocity
  Eigen::VectorXd held_velocity;     ///< m/s
};

/// M a + (damping M + stiffness_damping K) v + K u = load from rest, by steps of h with one sparse Cholesky
/// factor.
class TimeIntegrator {
 public:
  TimeIntegrator(LinearDynamics system, double h, const TimeScheme& scheme);
  ~TimeIntegrator();

  void step();
  /// Starts again from a displacement and a velocity, with the acceleration that belongs to them.
  void restart(const Eigen::VectorXd& u, const Eigen::VectorXd& v);
  const Eigen::VectorXd& u() const { return u_; }                       ///< m
  const Eigen::VectorXd& v() const { return v_; }                       ///< m/s
  double kinetic_energy() const { return v_.dot(system_.M * v_) / 2; }  ///< J
  double elastic_energy() const { return u_.dot(system_.K * u_) / 2; }  ///< J

 private:
  Eigen::VectorXd solve_free(const Eigen::VectorXd& residual) const;

  LinearDynamics system_;
  double h_;
  TimeScheme scheme_;
  Eigen::VectorXd u_, v_, a_;
  std::vector<int> free_;
  struct Factor;
  std::unique_ptr<Factor> factor_;
};

}  // namespace testbed
