#include "massspring/contact/contact.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "meshing/algebra/subdomains.h"
#include "meshing/surface_energies/barrier.h"
#include "meshing/surface_energies/self_barrier.h"

namespace testbed::massspring {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

Vector3d velocity_of(const RigidBody& body, double t, double h) {
  return (body.translation(t + h) - body.translation(t)) / h;
}

/// Sets a node that goes from x0 to x with velocity v onto the body, which moves by `shift`, if it would end
/// within or beyond it. Returns whether it had to.
bool push_out_of(const RigidBody& body, const Vector3d& shift, const Vector3d& x0, double t, double h,
                 Vector3d& x, Vector3d& v) {
  const double reach = (x - x0 - shift).norm();
  RigidBody::Gap gap = body.gap(x, t + h);
  if (gap.distance >= reach) return false;  // a node that came from outside cannot have gone through
  const RigidBody::Gap first = body.gap(x0, t);
  if (gap.distance >= 0 || gap.normal.dot(first.normal) < 0) {
    constexpr double kNear = 1e-6;  // of the way
    const auto touch = body.first_touch(x0, x, t, h, kNear * reach);
    if (!touch && gap.distance >= 0) return false;
    if (touch) {  // what is left of the way goes along the surface
      const Vector3d n = body.gap(*touch, t + h).normal, rest = x - *touch;
      x = *touch + rest - std::min(0.0, n.dot(rest)) * n;
    }
    gap = body.gap(x, t + h);
  }
  const Vector3d relative = v - shift / h;
  const double into = -gap.normal.dot(relative);
  Vector3d dv = Vector3d::Zero();
  if (into > 0) {
    const Vector3d along = relative + into * gap.normal;
    const double speed = along.norm(), taken = std::min(speed, body.friction * into);
    dv = into * gap.normal;
    if (taken > 0) {
      dv -= taken / speed * along;
      x -= h * taken / speed * along;
      gap = body.gap(x, t + h);
    }
  }
  if (gap.distance < 0) x -= gap.distance * gap.normal;
  v += dv;
  return true;
}

/// Of a blow that changed a node's momentum by p along a body that moves by `shift` in h seconds: its work, and what
/// friction took of the velocity v that the node had.
void add_blow(const RigidBody& body, const Vector3d& shift, double h, const Vector3d& p, double mass,
              const Vector3d& normal, const Vector3d& v, meshing::EnergyFlows& flows) {
  flows.obstacles += p.dot(shift) / h;
  const Vector3d along = p - normal.dot(p) * normal, slip = v + p / (2 * mass) - shift / h;
  if (body.friction > 0) flows.friction -= along.dot(slip);
}

/// Per node, whether supports hold it in all directions.
std::vector<char> constrained_nodes(const MassSpringModel& model,
                                    const std::vector<Constraint>& constraints) {
  std::vector<char> is_constrained(model.network.X.cols(), false);
  for (const Constraint& c : constraints) is_constrained[c.node] = c.S.isZero(0);
  return is_constrained;
}

}  // namespace

Contacts contacts_of(const Scene& scene, const SurfaceMesh& surface) {
  Contacts contacts;
  for (const Obstacle& obstacle : scene.obstacles) contacts.bodies.emplace_back(obstacle);
  if (scene.self_contact.is_on) {
    contacts.self_thickness = scene.self_contact.thickness.value_or(default_thickness(surface.X, surface.F));
    contacts.self_friction = scene.self_contact.friction;
  }
  return contacts;
}

SurfaceEnergies barriers_of(const Contacts& contacts, const MassSpringModel& model,
                            const std::vector<Constraint>& constraints) {
  SurfaceEnergies barriers;
  const Matrix3Xd& X = model.network.X;
  const double E = model.material.E;
  if (!contacts.bodies.empty())
    barriers.push_back(
        barrier_around(contacts.bodies, X, model.network.F, E, constrained_nodes(model, constraints)));
  if (contacts.self_thickness)
    barriers.push_back(std::make_shared<SelfBarrier>(X, model.network.F, E, *contacts.self_thickness,
                                                     contacts.self_friction));
  return barriers;
}

void check_apart(const Contacts& contacts, const MassSpringModel& model,
                 const std::vector<Constraint>& constraints) {
  meshing::check_apart(contacts.bodies, model.network.X, model.network.F,
                       constrained_nodes(model, constraints));
}

void add_obstacles(const Contacts& contacts, const MassSpringModel& model, Forces& forces) {
  for (auto& energy : obstacles_in_statics(contacts.bodies, model.network.X, model.network.F,
                                           model.material.E, constrained_nodes(model, forces.constraints)))
    forces.surface.push_back(std::move(energy));
}

bool push_out(const std::vector<RigidBody>& bodies, const State& before, double h,
              const Eigen::VectorXd& mass, std::vector<Eigen::VectorXd>& clearances, Matrix3Xd& x,
              Matrix3Xd& v, meshing::EnergyFlows& flows) {
  clearances.resize(bodies.size());
  Matrix3Xd v_before;
  std::atomic<bool> has_pushed = false;
  for (size_t b = 0; b < bodies.size(); ++b) {
    const RigidBody& body = bodies[b];
    Eigen::VectorXd& clearance = clearances[b];
    if (clearance.size() == 0) clearance.setZero(x.cols());
    const Vector3d shift = h * velocity_of(body, before.t, h);
    const bool has_flows = body.friction > 0 || !shift.isZero(0);
    if (has_flows) v_before = v;
    for_each_chunk(x.cols(), [&](Eigen::Index begin, Eigen::Index end) {
      for (Eigen::Index i = begin; i < end; ++i) {
        clearance(i) -= (x.col(i) - before.x.col(i) - shift).lpNorm<1>();  // no shorter than the way
        if (clearance(i) > 0) continue;
        Vector3d xi = x.col(i), vi = v.col(i);
        if (push_out_of(body, shift, before.x.col(i), before.t, h, xi, vi)) {
          x.col(i) = xi;
          v.col(i) = vi;
          has_pushed = true;
        }
        clearance(i) = body.gap(xi, before.t + h).distance;
      }
    });
    if (!has_flows) continue;
    for (Eigen::Index i = 0; i < x.cols(); ++i)
      if (v.col(i) != v_before.col(i))
        add_blow(body, shift, h, mass(i) * (v.col(i) - v_before.col(i)), mass(i),
                 body.gap(x.col(i), before.t + h).normal, v_before.col(i), flows);
  }
  return has_pushed;
}

void constrain_active(const std::vector<RigidBody>& bodies, const State& state, double h,
                      std::vector<Constraint>& constraints, SlidingFriction& friction) {
  const std::vector<Touch>& touches = state.history.active_set;
  friction.force.setZero(3, state.x.cols());
  friction.start = state.x;
  friction.driven = 0;
  std::vector<Constraint*> of_node(state.x.cols(), nullptr);
  constraints.reserve(constraints.size() + touches.size());
  for (Constraint& c : constraints) of_node[c.node] = &c;
  for (const Touch& touch : touches) {
    const RigidBody& body = bodies[touch.body];
    const RigidBody::Gap gap = body.gap(state.x.col(touch.node), state.t);
    const Vector3d u = velocity_of(body, state.t, h) - gap.distance / h * gap.normal;
    Constraint*& c = of_node[touch.node];
    if (!c)
      c = &constraints.emplace_back(
          Constraint{touch.node, Eigen::Matrix3d::Identity(), Vector3d::Zero(), Vector3d::Zero()});
    // Along the directions that are still free, so that a support keeps its own.
    const Vector3d free_normal = c->S * gap.normal;
    if (touch.is_stuck) {
      c->velocity += c->S * u;
      c->S.setZero();
    } else if (const double size = free_normal.norm(); size > 1e-6) {
      const Vector3d n = free_normal / size;
      c->velocity += gap.normal.dot(u - c->velocity) / size * n;
      c->S -= n * n.transpose();
      const Vector3d shift = h * velocity_of(body, state.t, h);
      friction.force.col(touch.node) += touch.friction;
      friction.start.col(touch.node) += shift;
      friction.driven += touch.friction.dot(shift);
    }
  }
}

std::vector<Touch> settle_active(const std::vector<RigidBody>& bodies, const State& before, double h,
                                 const Eigen::VectorXd& mass, const Matrix3Xd& r, Matrix3Xd& x, Matrix3Xd& v,
                                 meshing::EnergyFlows& flows) {
  std::vector<Touch> kept;
  std::vector<char> is_touching(x.cols(), false);
  for (Touch touch : before.history.active_set) {
    const RigidBody& body = bodies[touch.body];
    flows.obstacles += h * r.col(touch.node).dot(velocity_of(body, before.t, h));
    const Vector3d n = body.gap(x.col(touch.node), before.t + h).normal;
    const double pressing = n.dot(r.col(touch.node));
    if (!(pressing > 0)) continue;
    const double limit = body.friction * pressing;
    Vector3d along = v.col(touch.node) - velocity_of(body, before.t, h);
    along -= n.dot(along) * n;
    if (touch.is_stuck) {
      const Vector3d holding = r.col(touch.node) - pressing * n;
      if (holding.norm() > limit) {
        touch.is_stuck = false;
        touch.friction = limit * holding.normalized();
      }
    } else if (limit > 0) {
      if (along.dot(touch.friction) > 0 || along.isZero(0))
        touch.is_stuck = true;  // friction would turn it back
      else
        touch.friction = -limit * along.normalized();
    }
    is_touching[touch.node] = true;
    kept.push_back(touch);
  }
  for (size_t b = 0; b < bodies.size(); ++b) {
    const Vector3d shift = h * velocity_of(bodies[b], before.t, h);
    for (Eigen::Index i = 0; i < x.cols(); ++i) {
      Vector3d xi = x.col(i), vi = v.col(i);
      if (!push_out_of(bodies[b], shift, before.x.col(i), before.t, h, xi, vi)) continue;
      add_blow(bodies[b], shift, h, mass(i) * (vi - v.col(i)), mass(i),
               bodies[b].gap(xi, before.t + h).normal, v.col(i), flows);
      x.col(i) = xi;
      v.col(i) = vi;
      if (is_touching[i]) continue;
      is_touching[i] = true;
      kept.push_back({static_cast<int>(i), static_cast<int>(b), false, Vector3d::Zero()});
    }
  }
  std::sort(kept.begin(), kept.end(), [](const Touch& a, const Touch& b) { return a.node < b.node; });
  return kept;
}

}  // namespace testbed::massspring
