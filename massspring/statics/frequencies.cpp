#include "massspring/statics/frequencies.h"

#include <Spectra/SymGEigsShiftSolver.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "meshing/algebra/cholesky.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using NodeVectors = Eigen::Map<const Matrix3Xd>;

/// (K + s M)^-1 on the free directions, as Spectra asks for it.
class Inverse {
 public:
  using Scalar = double;
  Inverse(const BlockCholesky& factor, int n_nodes, const std::vector<Constraint>& constraints)
      : factor_(factor), n_nodes_(n_nodes), constraints_(constraints) {}
  Eigen::Index rows() const { return 3 * n_nodes_; }
  Eigen::Index cols() const { return rows(); }
  void set_shift(double) {}  // in the factor already
  void perform_op(const double* x, double* y) const {
    Matrix3Xd b = NodeVectors(x, 3, n_nodes_), solution;
    filter(constraints_, b);
    factor_.solve(b, solution);
    filter(constraints_, solution);
    Eigen::Map<Matrix3Xd>(y, 3, n_nodes_) = solution;
  }

 private:
  const BlockCholesky& factor_;
  int n_nodes_;
  const std::vector<Constraint>& constraints_;
};

/// M, likewise.
class Mass {
 public:
  using Scalar = double;
  explicit Mass(const MassSpringModel& model) : model_(model) {}
  Eigen::Index rows() const { return 3 * model_.mass.size(); }
  Eigen::Index cols() const { return rows(); }
  void perform_op(const double* x, double* y) const {
    Eigen::Map<Matrix3Xd>(y, 3, model_.mass.size()) = momenta(model_, NodeVectors(x, 3, model_.mass.size()));
  }

 private:
  const MassSpringModel& model_;
};

}  // namespace

Eigen::VectorXd natural_frequencies(const MassSpringModel& model, const std::vector<Constraint>& constraints,
                                    int n) {
  constexpr double kShift = 1e-8;  // of the highest eigenvalue: far below the first elastic one
  constexpr double kZero = 1e-6;   // of the last eigenvalue found
  constexpr double kTolerance = 1e-10;
  constexpr int kMaxRestarts = 1000;
  BlockMatrix K = stiffness_pattern(model);
  add_stiffness(model, initial_state(model), K);
  double highest = 0;
  for (int i = 0; i < K.rows(); ++i)
    highest = std::max(highest, K.block[K.diagonal[i]].trace() / model.mass(i));
  const double shift = kShift * highest;
  for (int i = 0; i < K.rows(); ++i) K.block[K.diagonal[i]].diagonal().array() += shift * model.mass(i);
  if (model.spread_mass) add_blocks(*model.spread_mass, -shift, K);
  filter(constraints, K);
  const BlockCholesky factor(K);
  if (!factor.is_ok())
    throw std::runtime_error("the stiffness has no Cholesky factor, expected a positive definite model");
  Inverse inverse(factor, K.rows(), constraints);
  Mass mass(model);
  const int n_krylov = std::min<int>(static_cast<int>(inverse.rows()), std::max(2 * n + 10, 30));
  Spectra::SymGEigsShiftSolver<Inverse, Mass, Spectra::GEigsMode::ShiftInvert> solver(inverse, mass, n,
                                                                                      n_krylov, -shift);
  solver.init();
  solver.compute(Spectra::SortRule::LargestMagn, kMaxRestarts, kTolerance, Spectra::SortRule::SmallestAlge);
  if (solver.info() != Spectra::CompInfo::Successful)
    throw std::runtime_error("natural frequencies: the Lanczos iteration has not converged");
  const Eigen::VectorXd squared = solver.eigenvalues();
  Eigen::VectorXd frequencies = Eigen::VectorXd::Zero(n);
  for (int k = 0; k < n; ++k)
    if (squared(k) > kZero * squared(n - 1)) frequencies(k) = std::sqrt(squared(k)) / (2 * M_PI);
  return frequencies;
}

double damping_of_ratio(const MassSpringModel& model, const std::vector<Constraint>& constraints,
                        double ratio) {
  constexpr int kTried = 24;
  for (double f : natural_frequencies(model, constraints, kTried))
    if (f > 0) return 2 * ratio * 2 * M_PI * f;
  throw std::runtime_error("material.damping_ratio = " + std::to_string(ratio) + ": the lowest " +
                           std::to_string(kTried) + " motions cost no energy, expected a vibration");
}

}  // namespace testbed::massspring
