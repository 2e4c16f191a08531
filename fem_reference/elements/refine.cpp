#include "fem_reference/elements/refine.h"

#include <algorithm>
#include <map>

namespace testbed::fem {

TetMesh refine(const TetMesh& mesh) {
  std::map<std::pair<int, int>, int> middle_of;
  const auto middle = [&](int a, int b) {
    return middle_of.try_emplace(std::minmax(a, b), static_cast<int>(mesh.X.cols() + middle_of.size()))
        .first->second;
  };
  TetMesh fine;
  fine.n_surface = mesh.n_surface;
  fine.T.resize(4, 8 * mesh.T.cols());
  for (int t = 0; t < mesh.T.cols(); ++t) {
    const int a = mesh.T(0, t), b = mesh.T(1, t), c = mesh.T(2, t), d = mesh.T(3, t);
    const int ab = middle(a, b), ac = middle(a, c), ad = middle(a, d), bc = middle(b, c), bd = middle(b, d),
              cd = middle(c, d);
    // Four corners, and the octahedron between them cut along its diagonal ac - bd.
    const int children[8][4] = {{a, ab, ac, ad},  {ab, b, bc, bd},  {ac, bc, c, cd},  {ad, bd, cd, d},
                                {ab, ac, ad, bd}, {ab, ac, bd, bc}, {ac, ad, bd, cd}, {ac, bc, cd, bd}};
    for (int k = 0; k < 8; ++k)
      for (int v = 0; v < 4; ++v) fine.T(v, 8 * t + k) = children[k][v];
  }
  fine.F.resize(3, 4 * mesh.F.cols());
  for (int f = 0; f < mesh.F.cols(); ++f) {
    const int a = mesh.F(0, f), b = mesh.F(1, f), c = mesh.F(2, f);
    const int ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    fine.F.col(4 * f) << a, ab, ca;
    fine.F.col(4 * f + 1) << ab, b, bc;
    fine.F.col(4 * f + 2) << ca, bc, c;
    fine.F.col(4 * f + 3) << ab, bc, ca;
  }
  fine.X.resize(3, mesh.X.cols() + static_cast<int>(middle_of.size()));
  fine.X.leftCols(mesh.X.cols()) = mesh.X;
  for (const auto& [ends, node] : middle_of)
    fine.X.col(node) = (mesh.X.col(ends.first) + mesh.X.col(ends.second)) / 2;
  return fine;
}

}  // namespace testbed::fem
