#include "massspring/model/mass.h"

#include <algorithm>
#include <map>
#include <utility>

#include "meshing/base/geometry.h"

namespace testbed::massspring {

ConsistentMass consistent_mass(const Eigen::Matrix3Xd& X, const Eigen::Matrix4Xi& T, double rho) {
  std::map<std::pair<int, int>, double> edges;
  for (const auto& t : T.colwise())
    for (int i = 0; i < 4; ++i)
      for (int j = i + 1; j < 4; ++j) edges[std::minmax({t[i], t[j]})] += rho / 20 * tet_volume(X, t);
  ConsistentMass mass{Eigen::Matrix2Xi(2, edges.size()), Eigen::VectorXd(edges.size())};
  Eigen::Index e = 0;
  for (const auto& [edge, r] : edges) {
    mass.E.col(e) << edge.first, edge.second;
    mass.r(e++) = r;
  }
  return mass;
}

void lump(const std::vector<int>& nodes, ConsistentMass& mass) {
  for (Eigen::Index e = 0; e < mass.E.cols(); ++e)
    for (int i : mass.E.col(e))
      if (std::binary_search(nodes.begin(), nodes.end(), i)) mass.r(e) = 0;
}

void add_product(const ConsistentMass& mass, double factor, const Eigen::Matrix3Xd& p, Eigen::Matrix3Xd& y) {
  for (Eigen::Index e = 0; e < mass.E.cols(); ++e) {
    const int i = mass.E(0, e), j = mass.E(1, e);
    const Eigen::Vector3d exchanged = factor * mass.r(e) * (p.col(i) - p.col(j));
    y.col(i) += exchanged;
    y.col(j) -= exchanged;
  }
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
