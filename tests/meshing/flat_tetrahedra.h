// Tetrahedra of which some have a nearly flat part.
#pragma once

#include <Eigen/Core>

namespace testbed::meshing {

/// Parts every fiftieth tetrahedron by a new node near one of its faces, so that one of the four parts has so little of its volume.
template <class Mesh>
void add_flat_tetrahedra(Mesh& mesh, double part_of_volume) {
  constexpr int kEvery = 50;
  const Eigen::Index n = mesh.X.cols(), m = mesh.T.cols(), n_parted = m / kEvery;
  mesh.X.conservativeResize(Eigen::NoChange, n + n_parted);
  mesh.T.conservativeResize(Eigen::NoChange, m + 3 * n_parted);
  for (int k = 0; k < n_parted; ++k) {
    const Eigen::Vector4i t = mesh.T.col(kEvery * k);
    const int p = static_cast<int>(n) + k;
    const Eigen::Matrix<double, 3, 4> x = mesh.X(Eigen::all, t);
    mesh.X.col(p) = (1 - part_of_volume) * x.leftCols(3).rowwise().mean() + part_of_volume * x.col(3);
    for (int c = 0; c < 4; ++c) {
      Eigen::Vector4i part = t;
      part[c] = p;
      mesh.T.col(c == 0 ? kEvery * k : m + 3 * k + c - 1) = part;
    }
  }
}

}  // namespace testbed::meshing
