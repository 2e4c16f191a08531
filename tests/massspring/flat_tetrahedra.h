// Tetrahedra of which some have a nearly flat part.
#pragma once

#include "meshing/base/mesh.h"

namespace testbed::massspring {

/// Parts every fiftieth tetrahedron by a new node near one of its faces, so that one of the four parts has so little of its volume.
inline void add_flat_tetrahedra(SpringNetwork& network, double part_of_volume) {
  constexpr int kEvery = 50;
  const Eigen::Index n = network.X.cols(), m = network.T.cols(), n_parted = m / kEvery;
  network.X.conservativeResize(Eigen::NoChange, n + n_parted);
  network.T.conservativeResize(Eigen::NoChange, m + 3 * n_parted);
  for (int k = 0; k < n_parted; ++k) {
    const Eigen::Vector4i t = network.T.col(kEvery * k);
    const int p = static_cast<int>(n) + k;
    const Eigen::Matrix<double, 3, 4> x = network.X(Eigen::all, t);
    network.X.col(p) = (1 - part_of_volume) * x.leftCols(3).rowwise().mean() + part_of_volume * x.col(3);
    for (int c = 0; c < 4; ++c) {
      Eigen::Vector4i part = t;
      part[c] = p;
      network.T.col(c == 0 ? kEvery * k : m + 3 * k + c - 1) = part;
    }
  }
}

}  // namespace testbed::massspring
