#include "meshing/surface/surface.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <stdexcept>
#include <vector>

#include "meshing/surface/surface_faults.h"

namespace testbed::meshing {

double volume(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  if (X.cols() == 0) return 0;
  const Eigen::Vector3d centre = X.rowwise().mean();
  double six_volumes = 0;
  for (int f = 0; f < F.cols(); ++f)
    six_volumes += (X.col(F(0, f)) - centre).dot((X.col(F(1, f)) - centre).cross(X.col(F(2, f)) - centre));
  return six_volumes / 6;
}

double area(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  return area_vectors(X, F).colwise().norm().sum();
}

Eigen::Matrix3Xd area_vectors(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  Eigen::Matrix3Xd vectors(3, F.cols());
  for (int f = 0; f < F.cols(); ++f) {
    const Eigen::Vector3d a = X.col(F(0, f)), b = X.col(F(1, f)), c = X.col(F(2, f));
    vectors.col(f) = (b - a).cross(c - a) / 2;
  }
  return vectors;
}

Eigen::VectorXd vertex_areas(const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  const Eigen::VectorXd face_areas = area_vectors(X, F).colwise().norm();
  Eigen::VectorXd areas = Eigen::VectorXd::Zero(X.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int v : F.col(f)) areas[v] += face_areas[f] / 3;
  return areas;
}

bool is_closed(const Eigen::Matrix3Xi& F) {
  std::map<std::pair<int, int>, int> balance;
  for (const auto& t : F.colwise())
    for (int k = 0; k < 3; ++k) {
      const int a = t(k), b = t((k + 1) % 3);
      balance[std::minmax(a, b)] += a < b ? 1 : -1;
    }
  return std::all_of(balance.begin(), balance.end(), [](const auto& edge) { return edge.second == 0; });
}

Eigen::Matrix2Xi edges_of(const Eigen::Matrix3Xi& F) {
  std::vector<std::pair<int, int>> edges;
  edges.reserve(3 * F.cols());
  for (int f = 0; f < F.cols(); ++f)
    for (int c = 0; c < 3; ++c) edges.push_back(std::minmax<int>({F(c, f), F((c + 1) % 3, f)}));
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  Eigen::Matrix2Xi E(2, edges.size());
  for (size_t e = 0; e < edges.size(); ++e) E.col(e) << edges[e].first, edges[e].second;
  return E;
}

void check_closed(const SurfaceMesh& surface, const std::string& name) {
  const Eigen::Matrix3Xd& X = surface.X;
  const Eigen::Matrix3Xi& F = surface.F;
  if (F.cols() == 0) throw std::runtime_error(name + ": no triangles, expected a closed surface");
  if (F.minCoeff() < 0 || F.maxCoeff() >= X.cols())
    throw std::runtime_error(name + ": vertex indices " + std::to_string(F.minCoeff()) + " to " +
                             std::to_string(F.maxCoeff()) + ", expected 0 to " +
                             std::to_string(X.cols() - 1));
  if (!X.allFinite()) throw std::runtime_error(name + ": a coordinate is not finite");
  std::string faults;
  for (const std::string& line : describe(find_faults(surface), surface))
    faults += (faults.empty() ? "" : "; ") + line;
  if (!faults.empty()) throw std::runtime_error(name + ": " + faults);
}

}  // namespace testbed::meshing
