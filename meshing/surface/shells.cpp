#include "meshing/surface/shells.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <boost/pending/disjoint_sets.hpp>
#include <cmath>

#include "meshing/surface/surface.h"

namespace testbed::meshing {

namespace {

/// Number of the shell of each triangle, by shared vertices.
std::vector<int> label_triangles(const SurfaceMesh& surface, int& n_shells) {
  boost::disjoint_sets_with_storage<> connected(surface.X.cols());
  for (const auto& f : surface.F.colwise())
    for (int c : {1, 2}) connected.union_set(f[c], f[0]);
  std::vector<int> label_of_root(surface.X.cols(), -1), labels;
  n_shells = 0;
  for (const auto& f : surface.F.colwise()) {
    int& label = label_of_root[connected.find_set(f[0])];
    if (label < 0) label = n_shells++;
    labels.push_back(label);
  }
  return labels;
}

}  // namespace

double winding_number(const Eigen::Vector3d& x, const Eigen::Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  double total = 0;
  for (const auto& f : F.colwise()) {
    const Eigen::Vector3d a = X.col(f[0]) - x, b = X.col(f[1]) - x, c = X.col(f[2]) - x;
    const double la = a.norm(), lb = b.norm(), lc = c.norm();
    total += 2 * std::atan2(a.dot(b.cross(c)), la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb);
  }
  constexpr double kPi = 3.14159265358979323846;
  return total / (4 * kPi);
}

std::vector<Shell> shells_of(const SurfaceMesh& surface) {
  const Eigen::Matrix3Xd& X = surface.X;
  const Eigen::Matrix3Xi& F = surface.F;
  int n_shells = 0;
  const std::vector<int> labels = label_triangles(surface, n_shells);
  std::vector<Shell> shells(n_shells);
  for (int f = 0; f < F.cols(); ++f) shells[labels[f]].triangles.push_back(f);

  std::vector<Eigen::Matrix3Xi> faces(n_shells);
  std::vector<Eigen::AlignedBox3d> boxes(n_shells);
  for (int s = 0; s < n_shells; ++s) {
    faces[s] = F(Eigen::all, shells[s].triangles);
    for (int v : faces[s].reshaped()) boxes[s].extend(X.col(v));
    shells[s].volume = volume(X, faces[s]);
  }
  for (int s = 0; s < n_shells; ++s)
    for (int other = 0; other < n_shells; ++other) {
      if (other == s || !boxes[other].contains(boxes[s])) continue;
      if (std::abs(winding_number(X.col(faces[s](0, 0)), X, faces[other])) < 0.5) continue;
      ++shells[s].depth;
      int& parent = shells[s].parent;
      if (parent < 0 || std::abs(shells[other].volume) < std::abs(shells[parent].volume)) parent = other;
    }
  return shells;
}

}  // namespace testbed::meshing
