// What an energy of the surface answers to the solid that it acts on, whatever that is.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

namespace testbed::meshing {

/// Four nodes and what is between them: e = sum w_a x_a
/// joins the nearest points of two of the surface's parts.
struct NearPair {
  std::array<int, 4> node;
  std::array<double, 4> weight;
  Eigen::Vector3d normal;  ///< from the second part to the first, as they lay when they met
  double stiffness = 0;    ///< N/m
};

/// Hessian (N/m) of surface energies, whose entries may lie outside the solid's pattern.
struct SurfaceHessian {
  std::vector<Eigen::Matrix3d> diagonal;  ///< a block per node; empty: none
  std::vector<NearPair> pairs;            ///< each adds stiffness (w_a n)(w_b n)^T between its nodes a and b

  bool empty() const { return diagonal.empty() && pairs.empty(); }
  void clear();
  void scale(double factor);

  /// Adds its diagonal blocks, those of the pairs among them.
  void add_diagonal(std::vector<Eigen::Matrix3d>& blocks) const;

  /// y += H p on the first three rows; sums over pairs are in double precision.
  template <class Field>
  void add_product(const Field& p, Field& y) const {
    using Scalar = typename Field::Scalar;
    for (size_t i = 0; i < diagonal.size(); ++i)
      y.col(i).template head<3>() += diagonal[i].template cast<Scalar>() * p.col(i).template head<3>();
    for (const NearPair& pair : pairs) {
      double closing = 0;
      for (int a = 0; a < 4; ++a)
        closing +=
            pair.weight[a] * pair.normal.dot(p.col(pair.node[a]).template head<3>().template cast<double>());
      for (int a = 0; a < 4; ++a)
        y.col(pair.node[a]).template head<3>() +=
            (pair.stiffness * closing * pair.weight[a] * pair.normal).template cast<Scalar>();
    }
  }
};

/// An energy of the positions x (3 x n, m), in the order in which a step by Newton's method calls it.
class SurfaceEnergy {
 public:
  virtual ~SurfaceEnergy() = default;

  /// A step of h seconds begins at t (s) and x: what it keeps fixed meanwhile is taken from there.
  virtual void begin_step(double t, double h, const Eigen::Matrix3Xd& x) = 0;

  /// Moves the first guess y to where the energy is finite, coming from x. Returns whether it had to.
  virtual bool keep_out(const Eigen::Matrix3Xd&, Eigen::Matrix3Xd&) const { return false; }

  virtual double energy(const Eigen::Matrix3Xd& x) const = 0;                         ///< J
  virtual void add_forces(const Eigen::Matrix3Xd& x, Eigen::Matrix3Xd& f) const = 0;  ///< N

  /// H += positive semidefinite part of the Hessian (N/m).
  virtual void add_hessian(const Eigen::Matrix3Xd& x, SurfaceHessian& H) const = 0;

  /// Largest part of the step dx from x within which nothing passes through, at most 1.
  virtual double largest_step(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&) const { return 1; }

  /// Newton's method went from x to y.
  virtual void follow(const Eigen::Matrix3Xd&, const Eigen::Matrix3Xd&) {}

  /// Whether largest_step may be less than 1.
  virtual bool bounds_steps() const { return false; }

  /// Whether rigid motions of the body leave the energy as it is.
  virtual bool is_invariant() const { return true; }
};

}  // namespace testbed::meshing
