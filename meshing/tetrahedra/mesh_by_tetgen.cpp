// The mesher of tetgen_worker.
#define TETLIBRARY
#include <tetgen.h>

#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "meshing/surface/surface_tree.h"
#include "meshing/tetrahedra/tet_worker.h"

namespace testbed::meshing {

TetNodes mesh_task(const TetTask& task, int, double) {
  const Eigen::Matrix3Xd& X = task.surface.X;
  const Eigen::Matrix3Xi& F = task.surface.F;
  tetgenio in, points, out;
  in.numberofpoints = static_cast<int>(X.cols());
  in.pointlist = new REAL[X.size()];
  std::copy_n(X.data(), X.size(), in.pointlist);
  in.numberoffacets = static_cast<int>(F.cols());
  in.facetlist = new tetgenio::facet[F.cols()];
  for (int f = 0; f < F.cols(); ++f) {
    tetgenio::facet& facet = in.facetlist[f];
    tetgenio::init(&facet);
    facet.numberofpolygons = 1;
    facet.polygonlist = new tetgenio::polygon[1];
    tetgenio::init(facet.polygonlist);
    facet.polygonlist->numberofvertices = 3;
    facet.polygonlist->vertexlist = new int[3]{F(0, f), F(1, f), F(2, f)};
  }
  points.numberofpoints = static_cast<int>(task.interior.cols());
  points.pointlist = new REAL[task.interior.size() + 1];
  std::copy_n(task.interior.data(), task.interior.size(), points.pointlist);

  std::string switches = "pYq1.4";  // Y: the surface stays as it is
  if (task.interior.cols() > 0) {
    switches +=
        'i';  // with lengths of edges as well, of which these points have none, it does not end or crashes
  } else {
    switches += 'm';  // edge lengths inside
    in.numberofpointmtrs = 1;
    in.pointmtrlist = new REAL[X.cols()];
    std::copy_n(task.size.data(), X.cols(), in.pointmtrlist);
  }
  if (task.longest > 0) {
    char text[32];  // all digits: that of a small body is no more than 0.000000 to six decimals
    std::snprintf(text, sizeof text, "a%.17g", std::pow(task.longest, 3) / (6 * std::sqrt(2.0)));
    switches += text;
  }
  try {
    tetrahedralize(switches.data(), &in, &out, &points);
  } catch (int code) {
    throw std::runtime_error("tetgen ends with code " + std::to_string(code));
  }

  // tetgen fills cavities too: what lies outside is left out, with its nodes
  const Eigen::Map<const Eigen::Matrix3Xd> all(out.pointlist, 3, out.numberofpoints);
  const Eigen::Map<const Eigen::Matrix4Xi> tets(out.tetrahedronlist, 4, out.numberoftetrahedra);
  const SurfaceTree tree(task.surface);
  const int n_given = static_cast<int>(X.cols() + task.interior.cols());
  std::vector<int> inside, kept, new_index(all.cols(), -1);
  for (int t = 0; t < tets.cols(); ++t) {
    const Eigen::Vector3d centre = all(Eigen::all, tets.col(t)).rowwise().mean();
    if (tree.depth(centre) > 0) inside.push_back(t);
  }
  TetNodes nodes{{}, tets(Eigen::all, inside)};
  for (int v = 0; v < n_given; ++v) new_index[v] = v;
  for (int v : nodes.T.reshaped())
    if (v >= n_given) new_index[v] = 0;
  for (int v = 0; v < all.cols(); ++v)
    if (new_index[v] >= 0) {
      new_index[v] = static_cast<int>(kept.size());
      kept.push_back(v);
    }
  nodes.X = all(Eigen::all, kept);
  for (int& v : nodes.T.reshaped()) v = new_index[v];
  return nodes;
}

}  // namespace testbed::meshing
