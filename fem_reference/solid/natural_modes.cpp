#include "fem_reference/solid/natural_modes.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>

#include "fem_reference/base/processes.h"
#include "fem_reference/solid/free_unknowns.h"
#include "meshing/algebra/cholesky.h"
#include "meshing/algebra/lowest_modes.h"

namespace testbed::fem {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using meshing::SparseCholesky;
using Sparse = Eigen::SparseMatrix<double>;

Modes natural_modes(const Sparse& stiffness, const Sparse& full_mass, const std::vector<int>& constrained,
                    int n, const MatrixXd& roots) {
  const std::vector<int> free = all_but(constrained, stiffness.rows());
  const Sparse K = restricted(stiffness, free), M = restricted(full_mass, free);
  // Far below the first elastic eigenvalue, far above rounding.
  constexpr double kShift = 1e-8, kZero = 1e-12;
  const double highest = (K.diagonal().array() / M.diagonal().array()).maxCoeff();
  const SparseCholesky factor(K + kShift * highest * M);
  if (!factor.is_ok()) refuse_indefinite();
  meshing::Pencil pencil{[&](const MatrixXd& x) -> MatrixXd { return K.selfadjointView<Eigen::Lower>() * x; },
                         [&](const MatrixXd& x) -> MatrixXd { return M.selfadjointView<Eigen::Lower>() * x; },
                         [&](const MatrixXd& x) -> MatrixXd { return factor.solve(x); }, K.rows(),
                         kZero* highest};
  if (roots.cols() > 0) pencil = with_roots(pencil, roots(free, Eigen::all));
  const LowestModes found = lowest_modes(pencil, n);
  Modes modes{found.eigenvalue.cwiseSqrt() / (2 * M_PI), MatrixXd::Zero(stiffness.rows(), found.shape.cols()),
              found.n_zero};
  modes.shape(free, Eigen::all) = found.shape;
  return modes;
}

Modes natural_modes(const Dynamics& system, const ElasticSolid& solid, int n) {
  const Sparse &K = system.K, &M = system.M;
  if (!system.step_solver) return natural_modes(K, M, system.constrained, n, system.roots);
  constexpr double kZero = 1e-12, kOfInverse = 1e-9;
  const MatrixXd rigid = solid.rigid_motions_at_rest();
  const VectorXd mass = M.diagonal();
  VectorXd is_own = (mass.array() > 0).cast<double>();
  is_own(system.constrained).setZero();
  const auto by_columns = [&](const std::function<VectorXd(const VectorXd&)>& of) {
    return [of](const MatrixXd& x) -> MatrixXd {
      MatrixXd y(x.rows(), x.cols());
      for (Eigen::Index k = 0; k < x.cols(); ++k) y.col(k) = of(x.col(k));
      return y;
    };
  };
  const auto product = [&](const Sparse& A) {
    return [&](const VectorXd& x) -> VectorXd {
      VectorXd all = x;
      system.exchange(all);
      return is_own.cwiseProduct(A * all);
    };
  };
  const auto sum = [](MatrixXd sums) {
    sum_over_processes(sums.reshaped());
    return sums;
  };
  const MatrixXd momenta = M * rigid;
  const auto inertia = sum(rigid.transpose() * momenta).ldlt();
  const StepSolver solver = system.step_solver(M, 0, VectorXd::Zero(K.rows()), 1, system.constrained);
  const auto inverse = [&](const VectorXd& b) -> VectorXd {  // on what is orthogonal to rigid motions in M
    VectorXd r = is_own.cwiseProduct(b), x = VectorXd::Zero(b.size());
    r -= momenta * inertia.solve(sum(rigid.transpose() * r));
    const double size = norm(r);
    if (!refine(
            solver, system.constrained, kOfInverse,
            [&] {
              return Balance{r - product(K)(x), size};
            },
            [&](const VectorXd& dx) { x += dx; }))
      refuse_indefinite();
    return is_own.cwiseProduct(x - rigid * inertia.solve(sum(momenta.transpose() * is_own.cwiseProduct(x))));
  };
  const double highest =
      largest_over_processes((mass.array() > 0).select(K.diagonal().array() / mass.array(), 0).maxCoeff());
  meshing::Pencil pencil{by_columns(product(K)), by_columns(product(M)),
                         by_columns(inverse),    K.rows(),
                         kZero * highest,        [](MatrixXd& sums) { sum_over_processes(sums.reshaped()); }};
  if (system.roots.cols() > 0) pencil = with_roots(pencil, is_own.asDiagonal() * system.roots);
  const LowestModes found = lowest_modes(pencil, n);
  return {found.eigenvalue.cwiseSqrt() / (2 * M_PI), found.shape, static_cast<int>(rigid.cols())};
}

}  // namespace testbed::fem
