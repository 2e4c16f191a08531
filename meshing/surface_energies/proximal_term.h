// What lets Newton's method begin where nothing holds a body yet.
#pragma once

#include "meshing/surface_energies/surface_energy.h"

namespace testbed::meshing {

/// Energy c/2 |x - x_k|^2 (J) about the last iterate x_k [Rockafellar 1976]: a body that nothing holds yet falls
/// until something does. Where iterates end its force is none, so that equilibria are those without it.
class ProximalTerm : public SurfaceEnergy {
 public:
  /// @param stiffness  c of every node (N/m)
  explicit ProximalTerm(double stiffness) : stiffness_(stiffness) {}

  void begin_step(double, double, const Eigen::Matrix3Xd& x) override { last_ = x; }
  double energy(const Eigen::Matrix3Xd& x) const override {
    return stiffness_ / 2 * (x - last_).squaredNorm();
  }
  void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const override {
    f -= stiffness_ * (x - last_);
  }
  void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H, Curvature) const override {
    H.diagonal.resize(x.cols(), Eigen::Matrix3d::Zero());
    for (Eigen::Matrix3d& block : H.diagonal) block.diagonal().array() += stiffness_;
  }
  void follow(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd& y) override { last_ = y; }
  bool is_stiff() const override { return true; }  // a part of contact
  bool is_invariant() const override { return false; }

 private:
  double stiffness_;
  Eigen::Matrix3Xd last_;
};

/// So soft beside a body that it hardly slows it, and so stiff that what linear solves leave of rigid motions stays small.
/// @param E  Young's modulus (Pa)
/// @param size  of the body, of n nodes (m)
inline std::shared_ptr<ProximalTerm> soft_proximal_term(double E, double size, Eigen::Index n) {
  constexpr double kSoft = 1e-3;
  return std::make_shared<ProximalTerm>(kSoft * E * size / static_cast<double>(n));
}

}  // namespace testbed::meshing
