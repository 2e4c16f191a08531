#include "massspring/model/mass.h"

#include <algorithm>
#include <array>
#include <vector>

#include "meshing/base/geometry.h"

namespace testbed::massspring {

ConsistentMass consistent_mass(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, double rho) {
  std::vector<std::array<int, 3>> edges;  // of every tetrahedron: their ends, and which it is
  edges.reserve(6 * T.cols());
  for (const auto& t : T.colwise())
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j)
        edges.push_back({std::min(t[i], t[j]), std::max(t[i], t[j]), static_cast<int>(edges.size())});
  std::sort(edges.begin(), edges.end());
  const auto is_new = [&](std::size_t k) {
    return k == 0 || edges[k][0] != edges[k - 1][0] || edges[k][1] != edges[k - 1][1];
  };
  Eigen::Index n_edges = 0;
  for (std::size_t k = 0; k < edges.size(); ++k) n_edges += is_new(k);
  ConsistentMass mass{Eigen::Matrix2Xi(2, n_edges), Eigen::VectorXd::Zero(n_edges)};
  Eigen::Index e = -1;
  for (std::size_t k = 0; k < edges.size(); ++k) {
    if (is_new(k)) mass.E.col(++e) << edges[k][0], edges[k][1];
    mass.r(e) += rho / 20 * tet_volume(X, T.col(edges[k][2] / 6));
  }
  return mass;
}

void lump(const std::vector<int>& nodes, ConsistentMass& mass) {
  for (Eigen::Index e = 0; e < mass.E.cols(); ++e)
    for (int i : mass.E.col(e))
      if (std::binary_search(nodes.begin(), nodes.end(), i)) mass.r(e) = 0;
}

void add_diagonal(const ConsistentMass& mass, double factor, std::vector<Eigen::Matrix3d>& blocks) {
  for (Eigen::Index e = 0; e < mass.E.cols(); ++e)
    for (const int i : mass.E.col(e)) blocks[i].diagonal().array() += factor * mass.r(e);
}

void add_blocks(const ConsistentMass& mass, double factor, BlockMatrix& A) {
  for (Eigen::Index e = 0; e < mass.E.cols(); ++e) {
    const int i = mass.E(0, e), j = mass.E(1, e);
    const double r = factor * mass.r(e);
    A.block[A.diagonal[i]].diagonal().array() += r;
    A.block[A.diagonal[j]].diagonal().array() += r;
    A.block[A.find(i, j)].diagonal().array() -= r;
    A.block[A.find(j, i)].diagonal().array() -= r;
  }
}

}  // namespace testbed::massspring
