#include "meshing/surface_energies/barrier.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "meshing/algebra/rigid_motion.h"
#include "meshing/surface/surface.h"
#include "meshing/surface_energies/contact_laws.h"
#include "meshing/surface_energies/proximal_term.h"
#include "meshing/surface_energies/surface_points.h"

namespace testbed::meshing {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

namespace {

double diagonal_of(const Matrix3Xd& X) {
  return (X.rowwise().maxCoeff() - X.rowwise().minCoeff()).norm();
}

constexpr double kClosest = 1e-3;  // of the range: where ways end that would go in
constexpr double kFirst = 0.5;     // of the range: the first guess of a new contact's gap
constexpr double kLeast = 1e-3;    // of the area of a face that looks away, through which nothing passes

/// A barrier on points of faces, which count as far as they face a body.
class BarrierOnFaces : public EnergyOfPoints {
 public:
  BarrierOnFaces(std::shared_ptr<Barrier> barrier, ContactPoints points, const Matrix3Xd& X,
                 const Eigen::MatrixXi& faces)
      : EnergyOfPoints(barrier, points.W),
        barrier_(std::move(barrier)),
        shares_(std::move(points.shares)),
        corners_(faces.topRows<3>()) {
    weigh(0, X);
  }

  void begin_step(double t, double h, const Matrix3Xd& x) override {
    weigh(t, x);
    EnergyOfPoints::begin_step(t, h, x);
  }

 private:
  void weigh(double t, const Matrix3Xd& x) {
    const Matrix3Xd normals = area_vectors(x, corners_).colwise().normalized();
    const Matrix3Xd at = at_points(x);
    const std::vector<RigidBody>& bodies = barrier_->bodies();
    Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(at.cols(), static_cast<Eigen::Index>(bodies.size()));
    for (Eigen::Index b = 0; b < weights.cols(); ++b) {
      Matrix3Xd away(3, at.cols());
      for (Eigen::Index p = 0; p < at.cols(); ++p) away.col(p) = bodies[b].gap(at.col(p), t).normal;
      for (const ContactPoints::Share& share : shares_)
        weights(share.point, b) +=
            share.area * std::max(kLeast, -normals.col(share.face).dot(away.col(share.point)));
    }
    barrier_->set_weights(std::move(weights));
  }

  std::shared_ptr<Barrier> barrier_;
  std::vector<ContactPoints::Share> shares_;
  Eigen::Matrix3Xi corners_;
};

}  // namespace

Vector3d Barrier::slid(const Held& held, const Matrix3Xd& x) const {
  const Vector3d way = x.col(held.point) - held.start;
  return way - held.normal.dot(way) * held.normal;
}

/// N
Vector3d Barrier::friction_on(const Held& held, const Matrix3Xd& x) const {
  const Vector3d way = slid(held, x);
  return -held.limit / smooth_length(way.norm(), slip(held)).norm * way;
}

/// Of a point outside the body (N).
Vector3d Barrier::pressing_on(int point, size_t body, const RigidBody::Gap& gap) const {
  return -stiffness(point, body) * barrier_at(gap.distance, range(body)).db * gap.normal;
}

template <class Visit>
void Barrier::for_each_near(const Matrix3Xd& x, const Visit& visit) const {
  for (size_t b = 0; b < bodies_.size(); ++b)
    for (int i = 0; i < weights_.rows(); ++i)
      if (const RigidBody::Gap gap = bodies_[b].gap(x.col(i), t_); gap.distance < range(b)) visit(i, b, gap);
}

void Barrier::begin_step(double t, double h, const Matrix3Xd& x) {
  slip_ = kStillSpeed * h;
  t_before_ = t;
  t_ = t + h;
  start_ = x;
  held_.clear();
  find_friction(x, t);
}

/// Of the contact forces at x, bodies being where they are at t. Points in touch keep the friction foreseen.
void Barrier::find_friction(const Matrix3Xd& x, double t) {
  std::map<std::pair<size_t, int>, Vector3d> foreseen;
  for (const Held& held : held_) foreseen[{held.body, held.point}] = held.friction;
  held_.clear();
  for (size_t b = 0; b < bodies_.size(); ++b) {
    const RigidBody& body = bodies_[b];
    if (body.friction == 0) continue;
    const Vector3d shift = body.translation(t_) - body.translation(t_before_);
    for (int i = 0; i < weights_.rows(); ++i) {
      const RigidBody::Gap gap = body.gap(x.col(i), t);
      if (gap.distance <= 0 || gap.distance >= range(b)) continue;
      const double limit = body.friction * pressing_on(i, b, gap).norm();
      const auto known = foreseen.find({b, i});
      const Vector3d friction = known == foreseen.end() ? Vector3d::Zero() : known->second;
      held_.push_back({b, i, gap.normal, start_.col(i) + shift, limit, no_longer_than(limit, friction)});
    }
  }
}

bool Barrier::keep_out(const Matrix3Xd& x, Matrix3Xd& y) const {
  bool is_moved = false;
  for (size_t b = 0; b < bodies_.size(); ++b) {
    const RigidBody& body = bodies_[b];
    const double closest = kClosest * range(b), first = kFirst * range(b);
    for (int i = 0; i < weights_.rows(); ++i) {
      Vector3d yi = y.col(i);
      if (const auto touch = body.first_touch(x.col(i), yi, t_, 0, closest)) yi = *touch;
      // Newton's method doubles a gap that is far too small, so points in touch keep theirs.
      if (const RigidBody::Gap gap = body.gap(yi, t_); gap.distance < first) {
        const double before = body.gap(x.col(i), t_before_).distance;
        const double kept = before > closest ? std::min(before, first) : first;
        if (gap.distance < kept) yi += (kept - gap.distance) * gap.normal;
      }
      is_moved |= yi != y.col(i);
      y.col(i) = yi;
    }
  }
  return is_moved;
}

double Barrier::largest_step(const Matrix3Xd& x, const Matrix3Xd& dx) const {
  constexpr double kKept = 0.1;  // of the gap along the way
  double part = 1;
  for (const RigidBody& body : bodies_)
    for (int i = 0; i < weights_.rows(); ++i) {
      const Vector3d xi = x.col(i);
      const double gap = body.gap(xi, t_).distance, length = dx.col(i).norm();
      if (gap > part * length) continue;
      if (const auto touch = body.first_touch(xi, xi + part * dx.col(i), t_, 0, kKept * gap))
        part = std::min(part, (*touch - xi).norm() / length);
    }
  return part;
}

double Barrier::stored(const Matrix3Xd& x) const {
  double sum = 0;
  for_each_near(x, [&](int i, size_t b, const RigidBody::Gap& gap) {
    sum += gap.distance > 0 ? stiffness(i, b) * barrier_at(gap.distance, range(b)).b
                            : std::numeric_limits<double>::infinity();
  });
  return sum;
}

double Barrier::energy(const Matrix3Xd& x) const {
  double sum = stored(x);
  for (const Held& held : held_) sum += held.limit * smooth_length(slid(held, x).norm(), slip(held)).value;
  return sum;
}

double Barrier::friction(const Matrix3Xd& x) const {
  double sum = 0;
  for (const Held& held : held_)
    sum += held.limit *
           (smooth_length(slid(held, x).norm(), slip(held)).value - smooth_length(0, slip(held)).value);
  return sum;
}

double Barrier::work(const Matrix3Xd& x) const {
  const std::vector<Contact> with = contacts(x);
  double sum = 0;
  for (size_t b = 0; b < bodies_.size(); ++b)
    sum += with[b].force.dot(bodies_[b].translation(t_) - bodies_[b].translation(t_before_));
  return sum;
}

std::vector<Contact> Barrier::contacts(const Matrix3Xd& x) const {
  std::vector<Contact> with(bodies_.size());
  for_each_near(x, [&](int i, size_t b, const RigidBody::Gap& gap) {
    if (gap.distance <= 0) return;  // a body that begins in touch: keep_out parts them
    with[b].force += pressing_on(i, b, gap);
    with[b].area += weights_(i, static_cast<Eigen::Index>(b));
  });
  for (const Held& held : held_) with[held.body].force += friction_on(held, x);
  return with;
}

void Barrier::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for_each_near(x, [&](int i, size_t b, const RigidBody::Gap& gap) {
    if (gap.distance > 0) f.col(i) += pressing_on(i, b, gap);
  });
  for (const Held& held : held_) f.col(held.point) += friction_on(held, x);
}

void Barrier::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature) const {
  std::vector<Eigen::Matrix3d>& diagonal = H.diagonal;
  if (diagonal.empty()) diagonal.assign(x.cols(), Eigen::Matrix3d::Zero());
  for_each_near(x, [&](int i, size_t b, const RigidBody::Gap& gap) {
    if (gap.distance > 0)
      diagonal[i] +=
          stiffness(i, b) * barrier_at(gap.distance, range(b)).ddb * gap.normal * gap.normal.transpose();
  });
  for (const Held& held : held_)
    diagonal[held.point] +=
        friction_hessian(held.limit, held.normal, held.friction, slid(held, x), slip(held));
}

void Barrier::follow(const Matrix3Xd& x, const Matrix3Xd& y) {
  for (Held& held : held_)
    held.friction = friction_foreseen(held.limit, held.friction, slid(held, x), slid(held, y), slip(held));
  if (lag_ == FrictionLag::Iteration) find_friction(y, t_);
}

std::shared_ptr<SurfaceEnergy> barrier_around(const std::vector<RigidBody>& bodies, const Matrix3Xd& X,
                                              const Eigen::MatrixXi& faces, double E,
                                              const std::vector<char>& is_constrained, FrictionLag lag,
                                              std::optional<double> size, const IsCounted& is_counted) {
  constexpr double kRange = 1e-3;
  const double range = kRange * size.value_or(diagonal_of(X));
  ContactPoints points = contact_points(faces, X, is_constrained, is_counted);
  auto barrier = std::make_shared<Barrier>(Eigen::VectorXd::Zero(points.W.rows()), range, kStiff * E / range,
                                           bodies, lag);
  return std::make_shared<BarrierOnFaces>(std::move(barrier), std::move(points), X, faces);
}

SurfaceEnergies obstacles_in_statics(const std::vector<RigidBody>& bodies, const Matrix3Xd& X,
                                     const Eigen::MatrixXi& faces, double E,
                                     const std::vector<char>& is_constrained) {
  SurfaceEnergies energies{barrier_around(bodies, X, faces, E, is_constrained, FrictionLag::Iteration)};
  const Eigen::MatrixXd motions = rigid_motions(X);
  Eigen::Matrix<double, 6, 6> fixed = Eigen::Matrix<double, 6, 6>::Zero();
  for (Eigen::Index i = 0; i < X.cols(); ++i)
    if (is_constrained[i]) fixed += motions.middleRows<3>(3 * i).transpose() * motions.middleRows<3>(3 * i);
  if (free_rigid_motions(motions, fixed).cols() > 0)
    energies.push_back(soft_proximal_term(E, diagonal_of(X), X.cols()));
  return energies;
}

}  // namespace testbed::meshing
