#include "fem_reference/dynamics.h"

#include <Spectra/MatOp/SparseSymMatProd.h>
#include <Spectra/SymGEigsShiftSolver.h>

#include <Eigen/CholmodSupport>
#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace testbed {
namespace {

using Sparse = Eigen::SparseMatrix<double>;
using Cholesky = Eigen::CholmodSupernodalLLT<Sparse>;

void factorise(const Sparse& A, Cholesky& factor) {
  factor.cholmod().print = 0;
  factor.compute(A);
  if (factor.info() != Eigen::Success)
    throw std::runtime_error("the matrix is not positive definite, expected sound tetrahedra and mass");
}

/// (K - sigma M)^-1 as Spectra asks for it.
class ShiftInvert {
 public:
  using Scalar = double;
  ShiftInvert(const Sparse& K, const Sparse& M) : K_(K), M_(M) {}
  Eigen::Index rows() const { return K_.rows(); }
  Eigen::Index cols() const { return K_.cols(); }
  void set_shift(double sigma) { factorise(K_ - sigma * M_, factor_); }
  void perform_op(const double* x, double* y) const {
    Eigen::Map<Eigen::VectorXd>(y, rows()) = factor_.solve(Eigen::Map<const Eigen::VectorXd>(x, rows()));
  }

 private:
  const Sparse &K_, &M_;
  Cholesky factor_;
};

/// Rows and columns `keep` of A.
Sparse restricted(const Sparse& A, const std::vector<int>& keep) {
  std::vector<int> place(A.rows(), -1);
  for (size_t i = 0; i < keep.size(); ++i) place[keep[i]] = static_cast<int>(i);
  std::vector<Eigen::Triplet<double>> entries;
  for (int j = 0; j < A.outerSize(); ++j)
    for (Sparse::InnerIterator entry(A, j); entry; ++entry)
      if (place[entry.row()] >= 0 && place[j] >= 0)
        entries.emplace_back(place[entry.row()], place[j], entry.value());
  const auto n = static_cast<Eigen::Index>(keep.size());
  Sparse part(n, n);
  part.setFromTriplets(entries.begin(), entries.end());
  return part;
}

std::vector<int> all_but(const std::vector<int>& held, Eigen::Index n) {
  std::vector<bool> is_held(n, false);
  for (int i : held) is_held[i] = true;
  std::vector<int> rest;
  for (int i = 0; i < n; ++i)
    if (!is_held[i]) rest.push_back(i);
  return rest;
}

}  // namespace

Modes natural_modes(const Sparse& stiffness, const Sparse& full_mass, const std::vector<int>& held, int n) {
  const std::vector<int> free = all_but(held, stiffness.rows());
  const Sparse K = restricted(stiffness, free), M = restricted(full_mass, free);
  // Far below the first elastic eigenvalue, far above rounding.
  constexpr double kShift = 1e-8, kZero = 1e-6;
  const double highest = (K.diagonal().array() / M.diagonal().array()).maxCoeff();
  ShiftInvert inverse(K, M);
  Spectra::SparseSymMatProd<double> mass(M);
  const int n_krylov = std::min<int>(static_cast<int>(K.rows()), std::max(2 * n + 10, 30));
  Spectra::SymGEigsShiftSolver<ShiftInvert, Spectra::SparseSymMatProd<double>,
                               Spectra::GEigsMode::ShiftInvert>
      solver(inverse, mass, n, n_krylov, -kShift * highest);
  solver.init();
  solver.compute(Spectra::SortRule::LargestMagn, 1000, 1e-10, Spectra::SortRule::SmallestAlge);
  if (solver.info() != Spectra::CompInfo::Successful)
    throw std::runtime_error("natural frequencies: the Lanczos iteration has not converged");
  const Eigen::VectorXd squared = solver.eigenvalues();
  Modes modes{Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Zero(stiffness.rows(), n), 0};
  modes.shape(free, Eigen::all) = solver.eigenvectors();
  for (int k = 0; k < n; ++k) {
    if (squared(k) < kZero * kShift * highest + 1e-6 * squared(n - 1)) {
      ++modes.n_rigid;
    } else {
      modes.frequency(k) = std::sqrt(squared(k)) / (2 * M_PI);
    }
  }
  return modes;
}

struct TimeIntegrator::Factor {
  Cholesky cholesky;
};

TimeIntegrator::TimeIntegrator(LinearDynamics system, double h, const TimeScheme& scheme)
    : system_(std::move(system)), h_(h), scheme_(scheme), factor_(std::make_unique<Factor>()) {
  const auto n = system_.K.rows();
  free_ = all_but(system_.held, n);
  restart(Eigen::VectorXd::Zero(n), Eigen::VectorXd::Zero(n));
  const auto& [alpha_m, alpha_f, beta, gamma] = scheme_;
  factorise(restricted(((1 - alpha_m) + (1 - alpha_f) * gamma * h_ * system_.damping) * system_.M +
                           (1 - alpha_f) * (beta * h_ + gamma * system_.stiffness_damping) * h_ * system_.K,
                       free_),
            factor_->cholesky);
}

TimeIntegrator::~TimeIntegrator() = default;

Eigen::VectorXd TimeIntegrator::solve_free(const Eigen::VectorXd& residual) const {
  Eigen::VectorXd a = Eigen::VectorXd::Zero(residual.size());
  a(free_) = factor_->cholesky.solve(residual(free_).eval()).eval();
  return a;
}

void TimeIntegrator::restart(const Eigen::VectorXd& u, const Eigen::VectorXd& v) {
  u_ = u;
  v_ = v;
  for (size_t k = 0; k < system_.held.size(); ++k) v_(system_.held[k]) = system_.held_velocity(k);
  Factor mass;
  factorise(restricted(system_.M, free_), mass.cholesky);
  const Eigen::VectorXd residual = system_.load - system_.damping * (system_.M * v_) -
                                   system_.K * (u_ + system_.stiffness_damping * v_).eval();
  a_ = Eigen::VectorXd::Zero(u.size());
  a_(free_) = mass.cholesky.solve(residual(free_).eval()).eval();
}

void TimeIntegrator::step() {
  const auto& [alpha_m, alpha_f, beta, gamma] = scheme_;
  // What is known of the state at the end; the held unknowns have no acceleration.
  const Eigen::VectorXd u = u_ + h_ * v_ + h_ * h_ * (0.5 - beta) * a_, v = v_ + h_ * (1 - gamma) * a_;
  const Eigen::VectorXd velocity = (1 - alpha_f) * v + alpha_f * v_;
  const Eigen::VectorXd residual =
      system_.load - system_.M * (alpha_m * a_ + system_.damping * velocity).eval() -
      system_.K * ((1 - alpha_f) * u + alpha_f * u_ + system_.stiffness_damping * velocity).eval();
  a_ = solve_free(residual);
  u_ = u + h_ * h_ * beta * a_;
  v_ = v + h_ * gamma * a_;
}

}  // namespace testbed
