#include "fem_reference/solid/free_unknowns.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "fem_reference/base/processes.h"

namespace testbed::fem {

using Eigen::VectorXd;
using Sparse = Eigen::SparseMatrix<double>;

void refuse_indefinite() {
  throw std::runtime_error("the matrix is not positive definite, expected sound tetrahedra and mass");
}

Sparse restricted(const Sparse& A, const std::vector<int>& keep) {
  std::vector<int> place(A.rows(), -1);
  for (size_t i = 0; i < keep.size(); ++i) place[keep[i]] = static_cast<int>(i);
  const auto n = static_cast<Eigen::Index>(keep.size());
  Sparse part(n, n);
  part.reserve(A.nonZeros() / 2 + n);
  for (int j = 0; j < n; ++j) {
    part.startVec(j);
    for (Sparse::InnerIterator entry(A, keep[j]); entry; ++entry)
      if (place[entry.row()] >= j) part.insertBack(place[entry.row()], j) = entry.value();
  }
  part.finalize();
  return part;
}

std::vector<int> all_but(const std::vector<int>& constrained, Eigen::Index n) {
  std::vector<bool> is_constrained(n, false);
  for (int i : constrained) is_constrained[i] = true;
  std::vector<int> rest;
  for (int i = 0; i < n; ++i)
    if (!is_constrained[i]) rest.push_back(i);
  return rest;
}

double norm(const VectorXd& r) {
  return std::sqrt(sum_over_processes(r.squaredNorm()));
}

bool refine(const StepSolver& solver, const std::vector<int>& constrained, double tolerance,
            const std::function<Balance()>& out_of_balance,
            const std::function<void(const VectorXd& correction)>& add) {
  constexpr int kMaxRefinements = 30;
  constexpr double kDeepest = 1e-5, kLost = 0.5, kRounding = 1e-10;
  double before = std::numeric_limits<double>::infinity();
  for (int n = 0; n < kMaxRefinements; ++n) {
    Balance forces = out_of_balance();
    forces.left(constrained).setZero();
    const double left = norm(forces.left);
    if (left <= tolerance * forces.size) return true;
    if (left > kLost * before) return left <= kRounding * forces.size;
    before = left;
    const auto correction = solver(forces.left, std::max(kDeepest, tolerance * forces.size / left / 2));
    if (!correction) return false;
    add(*correction);
  }
  return false;
}

}  // namespace testbed::fem
