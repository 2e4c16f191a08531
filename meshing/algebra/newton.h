// Newton's method with a line search.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>

#include "meshing/algebra/status.h"

namespace testbed::meshing {

struct NewtonReport {
  Status status = Status::Ok;  ///< Diverged: the gradient is not finite
  int iterations = 0;
  std::string reason;  ///< why it has not converged
};

/// A function of fields (3 x n) to minimise, at a point that it holds itself.
struct Objective {
  /// Of fields; the same in all processes that share them.
  std::function<double(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b)> dot =
      [](const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b) { return a.cwiseProduct(b).sum(); };
  /// Length of a field's longest column, as well.
  std::function<double(const Eigen::Matrix3Xd& a)> longest = [](const Eigen::Matrix3Xd& a) {
    return a.colwise().norm().maxCoeff();
  };
  std::function<double()> value;
  std::function<void(Eigen::Matrix3Xd& r)> negative_gradient;
  /// Whether the iteration ends at the point, as a minimum unless the report is told else; r: negative
  /// gradient.
  std::function<bool(const Eigen::Matrix3Xd& r, NewtonReport& report)> is_end;
  /// Solves H dx = r, H near the Hessian and dx downhill. Returns whether H is the Hessian itself.
  std::function<bool(const Eigen::Matrix3Xd& r, Eigen::Matrix3Xd& dx)> direction;
  /// The largest part of dx that may be taken.
  std::function<double(const Eigen::Matrix3Xd& dx)> largest_step = [](const Eigen::Matrix3Xd&) { return 1.; };
  /// Moves the point by `step` times dx, on a path that may bend, from where the last step was accepted.
  std::function<void(const Eigen::Matrix3Xd& dx, double step)> move;
  std::function<void()> accept;  ///< steps start from the point now
};

struct NewtonOptions {
  int max_iterations;
  double scale;               ///< of the value, for its rounding
  double step_tolerance = 0;  ///< the step is the last whose columns are all shorter
  /// Doubles steps while they descend where H is not the Hessian: it is stiffer than a body that buckles.
  /// Where there is no minimum they would not end.
  bool may_extend = false;
  /// The function is another one from each accepted point on.
  bool is_lagged = false;
};

/// Moves the point downhill to a minimum by Newton's method with backtracking [Armijo 1966].
/// Near the minimum values are flat to their rounding; there the gradient decides.
NewtonReport minimise(const Objective& f, const NewtonOptions& options);

}  // namespace testbed::meshing
