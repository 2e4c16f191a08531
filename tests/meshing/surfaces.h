// Small changes to surfaces, shared by the tests of meshing.
#pragma once

#include "meshing/mesh.h"

inline testbed::SurfaceMesh join(const testbed::SurfaceMesh& a, const testbed::SurfaceMesh& b) {
  testbed::SurfaceMesh both{Eigen::Matrix3Xd(3, a.X.cols() + b.X.cols()),
                            Eigen::Matrix3Xi(3, a.F.cols() + b.F.cols())};
  both.X << a.X, b.X;
  both.F << a.F, (b.F.array() + static_cast<int>(a.X.cols())).matrix();
  return both;
}

inline testbed::SurfaceMesh inside_out(testbed::SurfaceMesh mesh) {
  mesh.F.row(0).swap(mesh.F.row(1));
  return mesh;
}

inline testbed::SurfaceMesh scaled(testbed::SurfaceMesh mesh, double factor) {
  mesh.X *= factor;
  return mesh;
}

inline testbed::SurfaceMesh shifted(testbed::SurfaceMesh mesh, const Eigen::Vector3d& by) {
  mesh.X.colwise() += by;
  return mesh;
}
