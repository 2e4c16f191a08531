#include "meshing/surface_energies/handles.h"

#include <algorithm>

namespace testbed::meshing {

HandleSprings::HandleSprings(const SurfaceProblem::Held& held, const Eigen::Matrix3Xd& X,
                             const Eigen::Matrix3d& frame, double t)
    : held_(held), rest_(X(Eigen::all, held.vertices)), frame_(frame) {
  place(std::max(t, held.handle.start));
}

void HandleSprings::place(double t) {
  const Handle& handle = held_.handle;
  const bool holds = t >= handle.start && (!handle.end || t < *handle.end);
  stiffness_ = holds && rest_.cols() > 0 ? handle.stiffness / static_cast<double>(rest_.cols()) : 0;
  if (!handle.motion.empty()) shift_ = frame_.transpose() * position_at(handle.motion, t);
}

void HandleSprings::begin_step(double t, double h, const Eigen::Matrix3Xd&) {
  place(t + h);
}

double HandleSprings::energy(const Eigen::Matrix3Xd& x) const {
  return stiffness_ / 2 * ((x(Eigen::all, held_.vertices) - rest_).colwise() - shift_).squaredNorm();
}

void HandleSprings::add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const {
  for (Eigen::Index k = 0; k < rest_.cols(); ++k) {
    const int i = held_.vertices[k];
    f.col(i) += stiffness_ * (rest_.col(k) + shift_ - x.col(i));
  }
}

void HandleSprings::add_hessian(const Eigen::Matrix3Xd&, SurfaceHessian& H, Curvature) const {
  if (stiffness_ == 0) return;
  for (const int i : held_.vertices) H.blocks.push_back({i, i, stiffness_ * Eigen::Matrix3d::Identity()});
}

SurfaceEnergies handles_of(const SurfaceProblem& problem, const Eigen::Matrix3Xd& X,
                           const Eigen::Matrix3d& frame, double t) {
  SurfaceEnergies energies;
  for (const SurfaceProblem::Held& held : problem.held)
    energies.push_back(std::make_shared<HandleSprings>(held, X, frame, t));
  return energies;
}

}  // namespace testbed::meshing
