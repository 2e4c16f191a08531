#include "meshing/surface_energies/rigid_body.h"

#include <algorithm>
#include <memory>
#include <sstream>
#include <stdexcept>

#include "meshing/surface/surface_tree.h"

namespace testbed::meshing {
namespace {

using Eigen::Vector3d;
using Gap = RigidBody::Gap;

/// @param half  of unit normal
Gap gap_of(const HalfSpace& half, const Vector3d& x) {
  return {(x - half.point).dot(half.normal), half.normal};
}

Gap gap_to_point(const Vector3d& point, double radius, const Vector3d& x) {
  const double distance = (x - point).norm();
  return {distance - radius, distance > 0 ? Vector3d((x - point) / distance) : Vector3d::UnitY()};
}

Gap gap_of(const Ball& ball, const Vector3d& x) {
  return gap_to_point(ball.centre, ball.radius, x);
}

Gap gap_of(const Capsule& capsule, const Vector3d& x) {
  const Vector3d along = capsule.b - capsule.a;
  const double squared = along.squaredNorm();
  const double at = squared > 0 ? std::clamp((x - capsule.a).dot(along) / squared, 0.0, 1.0) : 0;
  return gap_to_point(capsule.a + at * along, capsule.radius, x);
}

Gap gap_of(const Box& box, const Vector3d& x) {
  const Vector3d nearest = x.cwiseMax(box.low).cwiseMin(box.high);
  if (nearest != x) return gap_to_point(nearest, 0, x);
  Eigen::Index low, high;
  const double to_low = (x - box.low).minCoeff(&low), to_high = (box.high - x).minCoeff(&high);
  return to_low < to_high ? Gap{-to_low, -Vector3d::Unit(low)} : Gap{-to_high, Vector3d::Unit(high)};
}

std::function<Gap(const Vector3d&)> gap_to_mesh(const ClosedMesh& mesh) {
  SurfaceSource source;
  source.file = mesh.file;
  const SurfaceMesh surface = load_surface(source);
  const Eigen::AlignedBox3d box(surface.X.rowwise().minCoeff(), surface.X.rowwise().maxCoeff());
  return [box, tree = std::make_shared<const SurfaceTree>(surface)](const Vector3d& x) -> Gap {
    Gap to_box = gap_of(Box{box.min(), box.max()}, x);
    if (to_box.distance > box.diagonal().norm()) return to_box;  // far enough for a lower bound to do
    const double depth = tree->depth(x);
    const Vector3d way = x - tree->nearest(x).point;
    return {-depth, depth == 0 ? to_box.normal : Vector3d(-way / depth)};
  };
}

}  // namespace

RigidBody::RigidBody(const Obstacle& obstacle, const Eigen::Matrix3d& frame)
    : friction(obstacle.friction),
      range(obstacle.range),
      may_overlap(obstacle.initially == Overlap::Resolve),
      motion_(obstacle.motion),
      is_flat_(std::holds_alternative<HalfSpace>(obstacle.shape)),
      is_convex_(!std::holds_alternative<ClosedMesh>(obstacle.shape)),
      gap_(std::visit(
          [](const auto& shape) -> std::function<Gap(const Vector3d&)> {
            if constexpr (std::is_same_v<decltype(shape), const ClosedMesh&>)
              return gap_to_mesh(shape);
            else if constexpr (std::is_same_v<decltype(shape), const HalfSpace&>)
              return [half = HalfSpace{shape.point, shape.normal.normalized()}](const Vector3d& x) {
                return gap_of(half, x);
              };
            else
              return [shape](const Vector3d& x) { return gap_of(shape, x); };
          },
          obstacle.shape)) {
  if (frame == Eigen::Matrix3d::Identity()) return;
  for (auto& point : motion_) point.tail<3>() = (frame.transpose() * point.tail<3>()).eval();
  gap_ = [frame, along_axes = std::move(gap_)](const Vector3d& x) -> Gap {
    const Gap gap = along_axes(frame * x);
    return {gap.distance, frame.transpose() * gap.normal};
  };
}

Vector3d RigidBody::translation(double t) const {
  return motion_.empty() ? Vector3d::Zero() : position_at(motion_, t);
}

std::optional<Vector3d> RigidBody::first_touch(const Vector3d& x, const Vector3d& y, double t, double h,
                                               double least) const {
  const Vector3d shift = translation(t + h), start = x - translation(t), way = y - shift - start;
  const double length = way.norm();
  const Gap first = gap_(start);
  if (first.distance < least)
    return first.normal.dot(way) < 0 ? std::optional<Vector3d>(start + shift) : std::nullopt;
  if (is_flat_) {
    const double last = gap_(start + way).distance;
    if (last >= least) return {};
    return start + (first.distance - least) / (first.distance - last) * way + shift;
  }
  double gone = 0;
  constexpr double kShortest = 1e-3;  // of `least`: a step, so that grazing ways end
  while (true) {
    const Vector3d at = length > 0 ? Vector3d(start + gone / length * way) : start;
    const Gap gap = gap_(at);
    if (gap.distance < least) return at + shift;
    if (gone >= length) return {};
    double step = gap.distance - least;
    if (is_convex_) {
      const double closing = -gap.normal.dot(way) / length;
      if (closing <= 0) return {};
      step /= closing;
    }
    gone = std::min(length, gone + std::max(step, kShortest * least));
  }
}

void check_apart(const std::vector<RigidBody>& obstacles, const Eigen::Matrix3Xd& X,
                 const Eigen::MatrixXi& faces, const std::vector<char>& is_constrained) {
  const double size = (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).norm();
  constexpr double kTouching = 1e-6, kInward = 1e-4;  // of the size
  double deepest = kTouching * size;
  std::string fault;
  const auto look = [&](size_t k, const Vector3d& x, const char* of, Eigen::Index vertex) {
    const double depth = -obstacles[k].gap(x, 0).distance;
    if (!(depth > deepest)) return;
    deepest = depth;
    std::ostringstream text;
    text << "obstacles[" << k << "]: " << of << vertex << " at (" << X.col(vertex).transpose()
         << ") m begins " << depth << " m inside, expected a body that begins outside or in touch";
    fault = text.str();
  };
  for (size_t k = 0; k < obstacles.size(); ++k) {
    if (obstacles[k].may_overlap) continue;
    for (Eigen::Index i = 0; i < X.cols(); ++i)
      if (!is_constrained[i]) look(k, X.col(i), "node ", i);
    // An obstacle may lie between nodes, or be the surface itself: just below a face that touches is the body.
    for (const auto& face : faces.colwise()) {
      if (is_constrained[face(0)] && is_constrained[face(1)] && is_constrained[face(2)]) continue;
      const Vector3d a = X.col(face(0)), b = X.col(face(1)), c = X.col(face(2)),
                     inward = -(b - a).cross(c - a).normalized();
      look(k, (a + b + c) / 3 + kInward * size * inward, "the face of node ", face(0));
    }
  }
  if (!fault.empty()) throw std::runtime_error(fault);
}

}  // namespace testbed::meshing
