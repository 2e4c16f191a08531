// The plain data every part of the testbed passes on: surfaces, spring networks and tetrahedra.
#pragma once

#include <Eigen/Core>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// How a surface's triangles were cut from those of another one, within their planes: the same polyhedron,
/// whose first vertices are the other's. Empty where nothing was cut.
struct Cuts {
  Eigen::Matrix3Xi F;        ///< 3 x m triangles before
  Eigen::Matrix3Xi between;  ///< 3 x n: vertices before that each lies between, repeated on an edge or in one
  Eigen::VectorXi parent;    ///< of each triangle, the one that it is a part of
};

/// Closed triangle surface, oriented outward. Lengths in metres.
struct SurfaceMesh {
  Eigen::Matrix3Xd X;  ///< 3 x n vertex positions (m)
  Eigen::Matrix3Xi F;  ///< 3 x m vertex indices, counter-clockwise seen from outside
  Cuts cuts = {};
};

/// Nodes joined by springs. Node i < n_surface is surface vertex i.
struct SpringNetwork {
  Eigen::Matrix3Xd X;  ///< 3 x n node positions at rest (m), surface vertices first
  Eigen::Matrix3Xi F;  ///< 3 x m surface triangles
  Eigen::Matrix2Xi E;  ///< 2 x n_springs node pairs (i < j), surface edges first; empty unless asked for
  Eigen::Matrix4Xi T;  ///< 4 x n_tets, positively oriented; empty unless asked for
  int n_surface = 0;
  Cuts cuts = {};  ///< of the surface
};

/// Nodes in and on a surface, and straight-sided tetrahedra that fill it. Node i < n_surface is surface
/// vertex i, bit for bit.
struct TetMesh {
  Eigen::Matrix3Xd X;  ///< 3 x n node positions (m), surface vertices first
  Eigen::Matrix4Xi T;  ///< 4 x n_tets node indices, positive volume; empty where none are asked for
  Eigen::Matrix3Xi F;  ///< 3 x m boundary triangles: exactly those of the surface
  int n_surface = 0;
};

}  // namespace testbed::meshing
