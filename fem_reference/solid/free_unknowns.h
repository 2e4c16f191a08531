// Linear systems of the unknowns of a motion that are not constrained.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <functional>
#include <vector>

#include "fem_reference/solid/elasticity.h"

namespace testbed::fem {

/// @throws std::runtime_error
[[noreturn]] void refuse_indefinite();

/// The lower triangle of rows and columns `keep` (ascending) of A.
Eigen::SparseMatrix<double> restricted(const Eigen::SparseMatrix<double>& A, const std::vector<int>& keep);

/// Of n unknowns, those that are not constrained, ascending.
std::vector<int> all_but(const std::vector<int>& constrained, Eigen::Index n);

/// Of forces of all processes, 0 where others own.
double norm(const Eigen::VectorXd& r);

struct Balance {
  Eigen::VectorXd left;  ///< out of balance (N)
  double size;           ///< of all forces (N)
};

/// Adds corrections by a solver in single precision until no more than `tolerance` of the forces is out of balance, or
/// rounding alone. Whether that is so.
bool refine(const StepSolver& solver, const std::vector<int>& constrained, double tolerance,
            const std::function<Balance()>& out_of_balance,
            const std::function<void(const Eigen::VectorXd& correction)>& add);

}  // namespace testbed::fem
