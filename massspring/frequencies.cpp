#include "massspring/frequencies.h"

#include <Spectra/SymEigsSolver.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "massspring/cholesky.h"

namespace testbed {
namespace {

using Eigen::Matrix3Xd;

/// M^1/2 (K + s M)^-1 M^1/2 on the free directions, as Spectra asks for it.
class Inverse {
 public:
  using Scalar = double;
  Inverse(const BlockCholesky& factor, const Eigen::VectorXd& mass,
          const std::vector<Constraint>& constraints)
      : factor_(factor), root_(mass.cwiseSqrt()), constraints_(constraints) {}
  Eigen::Index rows() const { return 3 * root_.size(); }
  Eigen::Index cols() const { return rows(); }
  void perform_op(const double* x, double* y) const {
    Matrix3Xd b = Eigen::Map<const Matrix3Xd>(x, 3, root_.size()) * root_.asDiagonal(), solution;
    filter(constraints_, b);
    factor_.solve(b, solution);
    filter(constraints_, solution);
    Eigen::Map<Matrix3Xd>(y, 3, root_.size()) = solution * root_.asDiagonal();
  }

 private:
  const BlockCholesky& factor_;
  Eigen::VectorXd root_;
  const std::vector<Constraint>& constraints_;
};

/// Integral of rho |u|^2 (kg m2), u linear in every tetrahedron.
double spread_norm(const MassSpringModel& model, const Matrix3Xd& u) {
  double sum = 0;
  for (const auto& t : model.network.T.colwise()) {
    const auto corners = u(Eigen::all, t);
    sum += rest_volume(model.network.X, t) / 20 *
           (corners.squaredNorm() + corners.rowwise().sum().squaredNorm());
  }
  return model.material.rho * sum;
}

}  // namespace

NaturalFrequencies natural_frequencies(const MassSpringModel& model,
                                       const std::vector<Constraint>& constraints, int n) {
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
  filter(constraints, K);
  const BlockCholesky factor(K);
  if (!factor.is_ok())
    throw std::runtime_error("the stiffness has no Cholesky factor, expected a positive definite model");
  Inverse inverse(factor, model.mass, constraints);
  const int n_krylov = std::min<int>(static_cast<int>(inverse.rows()), std::max(2 * n + 10, 30));
  Spectra::SymEigsSolver<Inverse> solver(inverse, n, n_krylov);
  solver.init();
  solver.compute(Spectra::SortRule::LargestAlge, kMaxRestarts, kTolerance);
  if (solver.info() != Spectra::CompInfo::Successful)
    throw std::runtime_error("natural frequencies: the Lanczos iteration has not converged");
  const Eigen::VectorXd squared = solver.eigenvalues().cwiseInverse().array() - shift;
  NaturalFrequencies frequencies{Eigen::VectorXd::Zero(n), {}};
  for (int k = 0; k < n; ++k)
    if (squared(k) > kZero * squared(n - 1)) frequencies.at_nodes(k) = std::sqrt(squared(k)) / (2 * M_PI);
  if (model.network.T.cols() == 0) return frequencies;
  frequencies.spread = frequencies.at_nodes;
  const Eigen::MatrixXd modes = solver.eigenvectors();  // M^1/2 x, of unit length
  for (int k = 0; k < n; ++k)
    frequencies.spread(k) /= std::sqrt(spread_norm(
        model, modes.col(k).reshaped(3, K.rows()) * model.mass.cwiseSqrt().cwiseInverse().asDiagonal()));
  return frequencies;
}

}  // namespace testbed
