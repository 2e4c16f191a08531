#include "meshing/network/rigidity.h"

#include <Eigen/CholmodSupport>
#include <Eigen/Dense>
#include <Eigen/SparseCore>
#include <boost/pending/disjoint_sets.hpp>
#include <stdexcept>
#include <vector>

namespace testbed::meshing {

namespace {

int count_parts(const SpringNetwork& network) {
  const int n = static_cast<int>(network.X.cols());
  boost::disjoint_sets_with_storage<> parts(n);
  for (const auto& e : network.E.colwise()) parts.union_set(e[0], e[1]);
  int n_parts = 0;
  for (int i = 0; i < n; ++i) n_parts += static_cast<int>(parts.find_set(i)) == i;
  return n_parts;
}

/// Stiffness matrix of unit springs, less a multiple of the identity; lower triangle.
Eigen::SparseMatrix<double> shifted_stiffness(const SpringNetwork& network, double shift) {
  const int n = 3 * static_cast<int>(network.X.cols());
  std::vector<Eigen::Triplet<double>> entries;
  for (int i = 0; i < n; ++i) entries.emplace_back(i, i, -shift);
  for (const auto& e : network.E.colwise()) {
    const Eigen::Vector3d d = (network.X.col(e[1]) - network.X.col(e[0])).normalized();
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) {
        const double value = d[r] * d[c];
        if (c <= r)
          for (int node : e) entries.emplace_back(3 * node + r, 3 * node + c, value);
        entries.emplace_back(3 * e[1] + r, 3 * e[0] + c, -value);  // e[0] < e[1]
      }
  }
  Eigen::SparseMatrix<double> K(n, n);
  K.setFromTriplets(entries.begin(), entries.end());
  return K;
}

}  // namespace

std::vector<int> weak_nodes(const SpringNetwork& network) {
  std::vector<Eigen::Matrix3d> spread(network.X.cols(), Eigen::Matrix3d::Zero());
  std::vector<int> n_springs(network.X.cols(), 0), weak;
  for (const auto& e : network.E.colwise()) {
    const Eigen::Vector3d d = (network.X.col(e[1]) - network.X.col(e[0])).normalized();
    for (int node : e) {
      spread[node] += d * d.transpose();
      ++n_springs[node];
    }
  }
  for (size_t i = 0; i < spread.size(); ++i) {
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread[i], Eigen::EigenvaluesOnly);
    if (n_springs[i] < 6 || solver.eigenvalues()[0] < kLeastBracing) weak.push_back(static_cast<int>(i));
  }
  return weak;
}

int count_floppy_modes(const SpringNetwork& network) {
  // Sylvester: the factor D of K - shift = L D L^T has as many negative entries as K has eigenvalues below
  // the shift. Without pivoting rounding grows by 1/shift at worst, to the shift itself; slender bodies have
  // eigenvalues of 1e-7 that a larger one would count.
  constexpr double kShift = 1e-8;
  Eigen::SparseMatrix<double> K = shifted_stiffness(network, kShift);
  cholmod_common common;
  cholmod_start(&common);
  common.supernodal = CHOLMOD_SIMPLICIAL;
  common.final_ll = 0;
  common.print = 0;
  cholmod_sparse view = Eigen::viewAsCholmod(Eigen::Ref<Eigen::SparseMatrix<double>>(K));
  view.stype = -1;  // the lower triangle of a symmetric matrix
  cholmod_factor* factor = cholmod_analyze(&view, &common);
  cholmod_factorize(&view, factor, &common);
  const bool is_done = common.status == CHOLMOD_OK && factor->minor == factor->n;
  int n_below = 0;
  for (size_t j = 0; is_done && j < factor->n; ++j)
    n_below += static_cast<double*>(factor->x)[static_cast<int*>(factor->p)[j]] < 0;
  cholmod_free_factor(&factor, &common);
  cholmod_finish(&common);
  if (!is_done) throw std::runtime_error("rigidity: the factorisation of the stiffness matrix fails");
  return n_below - 6 * count_parts(network);
}

}  // namespace testbed::meshing
