// What a scene prescribes on a surface, in numbers: made once for each that a program reads or solves on.
#pragma once

#include <functional>

#include "meshing/scene/scene.h"

namespace testbed::meshing {

struct SurfaceProblem {
  /// A support and the vertices that it holds, ascending. Where several hold a component, the last prescribes
  /// it.
  struct Constrained {
    std::vector<int> vertices;
    Support support;
  };
  std::vector<Constrained> constrained;
  /// Vertices tied to each other, and by how stiff a stitch (N/m).
  struct Stitch {
    int a, b;
    double stiffness;
  };
  std::vector<Stitch> stitches;
  /// A handle and the vertices that it pulls, ascending.
  struct Held {
    std::vector<int> vertices;
    Handle handle;
  };
  std::vector<Held> held;
  Eigen::Matrix3Xd traction;  ///< dead, of pressure also, on each triangle at rest (Pa), 3 x m
  /// Further traction of triangles at rest: the sum of the stress's terms times the outward normal.
  struct Stressed {
    std::vector<int> triangles;
    std::vector<StressTerm> terms;
  };
  std::vector<Stressed> stressed;
  Eigen::VectorXd
      follower_pressure;  ///< on each deformed triangle (Pa), m; triangles of one value are closed
};

/// The scene's supports, seams, handles and loads on its surface.
/// @throws std::runtime_error when a support, seam, handle or load meets no vertex or triangle, a seam ties a vertex to
/// itself, or a follower pressure acts on a part of a component of the surface.
SurfaceProblem discretise(const Scene& scene, const SurfaceMesh& surface);

/// The rigid motions of a surface's points X (3 x n) that supports leave free, 6 x m: translation (m) and turn (rad) about
/// the origin.
Eigen::MatrixXd free_motions(const SurfaceProblem& problem, const Eigen::Matrix3Xd& X);

/// Displacement (m) that a support prescribes at a time (s), in static scenes at a load factor.
Eigen::Vector3d displacement_at(const Support& support, const TimeOptions& time, double t);

/// Orthonormal directions in which a support prescribes its nodes' displacement.
std::vector<Eigen::Vector3d> constrained_directions(const Support& support);

/// Whether the support still prescribes in a step that begins at t (s).
bool holds_at(const Support& support, double t);

/// The part of a collapse that the material at a point at rest (m) takes: min(1, distance to the surface over
/// collapse.depth), or 1 where the surface collapses, too.
std::function<double(const Eigen::Vector3d& X)> collapsing_part(const Collapse& collapse,
                                                                const SurfaceMesh& surface);

/// Orthonormal axes, in columns, each of which every support either prescribes or leaves free: those of the
/// coordinates where they do. Absent where there are none.
std::optional<Eigen::Matrix3d> frame_of(const std::vector<Support>& supports);

/// The numbers as bytes, to compare what two programs solve.
std::string bytes_of(const SurfaceProblem& problem);

}  // namespace testbed::meshing
