// A box of tetrahedra with jittered inner nodes, for tests that need no mesher.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <map>
#include <vector>

#include "meshing/base/mesh.h"
#include "meshing/base/random.h"

namespace testbed::meshing {

/// nx x ny x nz cubes of side h, six tetrahedra each; nodes moved by up to jitter * h in every direction.
inline TetMesh box_tets(int nx, int ny, int nz, double h, double jitter = 0, std::uint64_t seed = 1) {
  TetMesh mesh;
  Random random(seed);
  const auto index = [&](int i, int j, int k) { return (k * (ny + 1) + j) * (nx + 1) + i; };
  mesh.X.resize(3, (nx + 1) * (ny + 1) * (nz + 1));
  for (int k = 0; k <= nz; ++k)
    for (int j = 0; j <= ny; ++j)
      for (int i = 0; i <= nx; ++i) {
        Eigen::Vector3d p(i, j, k);
        for (double& c : p) c += jitter * (2 * random.uniform() - 1);
        mesh.X.col(index(i, j, k)) = h * p;
      }
  std::vector<Eigen::Vector4i> tets;
  for (int k = 0; k < nz; ++k)
    for (int j = 0; j < ny; ++j)
      for (int i = 0; i < nx; ++i)
        for (const auto& order :
             {Eigen::Vector3i(0, 1, 2), Eigen::Vector3i(1, 2, 0), Eigen::Vector3i(2, 0, 1),
              Eigen::Vector3i(1, 0, 2), Eigen::Vector3i(0, 2, 1), Eigen::Vector3i(2, 1, 0)}) {
          Eigen::Vector3i corner(i, j, k);
          Eigen::Vector4i t;
          t[0] = index(i, j, k);
          for (int step = 0; step < 3; ++step) {
            ++corner[order[step]];
            t[step + 1] = index(corner[0], corner[1], corner[2]);
          }
          const Eigen::Vector3i& o = order;
          const bool is_even = (o[0] + 1) % 3 == o[1];
          if (!is_even) std::swap(t[2], t[3]);
          tets.push_back(t);
        }
  mesh.T.resize(4, tets.size());
  for (std::size_t t = 0; t < tets.size(); ++t) mesh.T.col(t) = tets[t];

  // The boundary: faces that belong to one tetrahedron, seen from outside.
  std::map<std::array<int, 3>, std::pair<int, Eigen::Vector3i>> faces;
  for (const Eigen::Vector4i& t : tets)
    for (const auto& f : {Eigen::Vector3i(t[0], t[2], t[1]), Eigen::Vector3i(t[0], t[1], t[3]),
                          Eigen::Vector3i(t[1], t[2], t[3]), Eigen::Vector3i(t[0], t[3], t[2])}) {
      std::array<int, 3> key{{f[0], f[1], f[2]}};
      std::sort(key.begin(), key.end());
      auto& entry = faces[key];
      ++entry.first;
      entry.second = f;
    }
  std::vector<Eigen::Vector3i> outer;
  for (const auto& [key, entry] : faces)
    if (entry.first == 1) outer.push_back(entry.second);
  mesh.F.resize(3, outer.size());
  for (std::size_t f = 0; f < outer.size(); ++f) mesh.F.col(f) = outer[f];
  mesh.n_surface = static_cast<int>(mesh.X.cols());
  return mesh;
}

}  // namespace testbed::meshing
