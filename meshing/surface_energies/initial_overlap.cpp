#include "meshing/surface_energies/initial_overlap.h"

#include <algorithm>
#include <sstream>
#include <stdexcept>

namespace testbed::meshing {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

namespace {

constexpr double kTouching = 1e-7;  // of the body's size

/// Nodes and centres of faces.
Matrix3Xd points_of(const Matrix3Xd& X, const Eigen::MatrixXi& faces) {
  Matrix3Xd points(3, X.cols() + faces.cols());
  points.leftCols(X.cols()) = X;
  for (Eigen::Index f = 0; f < faces.cols(); ++f)
    points.col(X.cols() + f) = (X.col(faces(0, f)) + X.col(faces(1, f)) + X.col(faces(2, f))) / 3;
  return points;
}

/// How far the deepest point lies inside an obstacle that is moved by `shift` (m).
double depth_in(const RigidBody& obstacle, const Matrix3Xd& points, const Vector3d& shift) {
  double depth = 0;
  for (const auto& x : points.colwise()) depth = std::max(depth, -obstacle.gap(x - shift, 0).distance);
  return depth;
}

/// By which the k-th obstacle is moved out of the body (m): against the mean of its normals where points lie inside.
Vector3d way_out(const RigidBody& obstacle, size_t k, const Matrix3Xd& points, double size) {
  constexpr double kOneSided = 0.1;  // of the sum of depths
  constexpr int kMaxStrides = 1000;
  Vector3d direction = Vector3d::Zero();
  double sum = 0;
  Eigen::Index n_inside = 0;
  for (const auto& x : points.colwise()) {
    const RigidBody::Gap gap = obstacle.gap(x, 0);
    if (gap.distance >= 0) continue;
    ++n_inside;
    sum -= gap.distance;
    direction += gap.distance * gap.normal;
  }
  if (n_inside < points.cols() && direction.norm() > kOneSided * sum) {
    direction.normalize();
    double way = 0;
    for (int n = 0; n < kMaxStrides; ++n) {
      const double depth = depth_in(obstacle, points, way * direction);
      if (depth <= kTouching * size) return way * direction;
      way += depth;
    }
  }
  std::ostringstream fault;
  fault << "obstacles[" << k
        << "] begins around the body or on all sides of it, expected initially = \"resolve\" "
        << "of one that overlaps it from one side";
  throw std::runtime_error(fault.str());
}

}  // namespace

std::optional<Scene> without_overlap(const Scene& scene, const std::vector<RigidBody>& obstacles,
                                     const Matrix3Xd& X, const Eigen::MatrixXi& faces,
                                     const Eigen::Matrix3d& frame) {
  const double size = (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).norm();
  const Matrix3Xd points = points_of(X, faces);
  Scene statics = scene;
  bool is_apart = true;
  for (size_t k = 0; k < obstacles.size(); ++k) {
    Obstacle& obstacle = statics.obstacles[k];
    const Vector3d end = obstacle.motion.empty() ? Vector3d::Zero() : position_at(obstacle.motion, 0);
    Vector3d start = end;
    if (obstacles[k].may_overlap && depth_in(obstacles[k], points, Vector3d::Zero()) > kTouching * size) {
      start += frame * way_out(obstacles[k], k, points, size);
      is_apart = false;
    }
    obstacle.motion = {{0, start.x(), start.y(), start.z()}, {1, end.x(), end.y(), end.z()}};
    obstacle.friction = 0;
    obstacle.initially = Overlap::Refuse;
  }
  if (is_apart) return {};
  statics.material.law = law_of(scene);
  statics.gravity.reset();
  statics.loads.clear();
  statics.initial.clear();
  statics.handles.clear();
  statics.events.clear();
  statics.collapse.reset();
  statics.load_scale = {};
  for (Support& support : statics.supports) {
    const Vector3d begin = support.motion.empty() ? Vector3d::Zero() : position_at(support.motion, 0);
    support.motion = {{0, begin.x(), begin.y(), begin.z()}};
    support.displacement.setZero();
    support.end.reset();
  }
  if (statics.volume && !statics.volume->target.empty())
    statics.volume->target = {{0, value_at(scene.volume->target, 0)}};
  statics.time.mode = TimeMode::Static;
  return statics;
}

Vector3d way_beside(const std::vector<RigidBody>& obstacles, const Matrix3Xd& X,
                    const Eigen::MatrixXi& faces) {
  const double size = (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).norm();
  const Matrix3Xd points = points_of(X, faces);
  Vector3d way = Vector3d::Zero();
  for (size_t k = 0; k < obstacles.size(); ++k) {
    const Matrix3Xd moved = points.colwise() + way;
    if (obstacles[k].may_overlap && depth_in(obstacles[k], moved, Vector3d::Zero()) > kTouching * size)
      way -= way_out(obstacles[k], k, moved, size);
  }
  for (size_t k = 0; k < obstacles.size() && !way.isZero(0); ++k)
    if (const double depth = depth_in(obstacles[k], points, -way); depth > 10 * kTouching * size) {
      std::ostringstream fault;
      fault << "obstacles[" << k << "]: the body, moved out of what it overlaps, lies " << depth
            << " m inside, expected room beside all obstacles or a support";
      throw std::runtime_error(fault.str());
    }
  return way;
}

}  // namespace testbed::meshing
