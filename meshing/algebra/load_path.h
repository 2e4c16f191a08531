// A path of equilibria under loads that grow.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <vector>

#include "meshing/base/namespace.h"

namespace testbed::meshing {

/// What a path needs of a body; x are fields (3 x n), positions or displacements.
struct LoadedBody {
  std::function<void(double load_factor, Eigen::Matrix3Xd& x)> prescribe;  ///< moves what supports move
  std::function<double(double load_factor, const Eigen::Matrix3Xd& x)> energy;
  /// Moves x, whose supports are where they belong, to equilibrium. Returns whether there is one.
  std::function<bool(double load_factor, Eigen::Matrix3Xd& x)> balance;
};

/// Follows a body's equilibria in adaptive load steps. A step starts where the last equilibria point to, if
/// the total energy is lower there. A step that finds no equilibrium is cut by halves, and later steps grow
/// again.
struct LoadPath {
  struct Equilibrium {
    double load_factor;
    Eigen::Matrix3Xd x;
  };

  /// @param x  equilibrium without loads
  explicit LoadPath(const Eigen::Matrix3Xd& x) : last{{0, x}} {}

  /// Moves x from where it is to equilibrium at the load factor. Returns whether it got there; if not, x is
  /// where it came to last.
  bool follow(const LoadedBody& body, double load_factor, Eigen::Matrix3Xd& x);

  /// Of the last equilibrium.
  double load_factor() const { return last.back().load_factor; }

  std::vector<Equilibrium> last;  ///< up to three, whose load factors differ; the latest at the end
  double stride = std::numeric_limits<double>::infinity();  ///< load factors that a step may go

 private:
  void predict(const LoadedBody& body, double load_factor, Eigen::Matrix3Xd& x) const;
};

}  // namespace testbed::meshing
