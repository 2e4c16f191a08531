#include "meshing/algebra/newton.h"

#include <cmath>
#include <optional>

namespace testbed::meshing {

NewtonReport minimise(const Objective& f, const NewtonOptions& options) {
  constexpr double kSufficientDecrease = 1e-4, kRounding = 1e-12;
  constexpr int kMaxHalvings = 40;
  NewtonReport report;
  Eigen::Matrix3Xd r, dx;
  std::optional<double> reached;  // the value where the last step ended
  const auto stop = [&](Status status, const std::string& reason) {
    report.status = status;
    report.reason = reason;
    return report;
  };
  while (true) {
    f.negative_gradient(r);
    const double norm = std::sqrt(f.dot(r, r));
    if (!std::isfinite(norm)) return stop(Status::Diverged, "the gradient is not finite");
    if (norm == 0 || (f.is_end && f.is_end(r, report))) return report;
    if (report.iterations == options.max_iterations)
      return stop(Status::NotConverged,
                  std::to_string(options.max_iterations) + " Newton iterations found no minimum");
    const bool is_exact = f.direction(r, dx);
    ++report.iterations;

    const double value = reached && !options.is_lagged ? *reached : f.value(), slope = -f.dot(r, dx);
    const bool is_flat = -slope < kRounding * (std::abs(value) + options.scale);
    const auto value_after = [&](double step) {
      f.move(dx, step);
      return f.value();
    };
    const auto has_smaller_gradient = [&] {
      f.negative_gradient(r);
      return std::sqrt(f.dot(r, r)) < norm;
    };
    bool is_accepted = false;
    double step = f.largest_step(dx), moved = 0;
    for (int halving = 0; halving < kMaxHalvings; ++halving, step /= 2) {
      moved = value_after(step);
      is_accepted =
          moved <= value + kSufficientDecrease * step * slope || (is_flat && has_smaller_gradient());
      if (is_accepted) break;
    }
    if (is_accepted && step == 1 && options.may_extend && !is_exact && !is_flat) {
      for (double further = value_after(2); further < moved; further = value_after(2 * step)) {
        step *= 2;
        moved = further;
      }
      f.move(dx, step);
    }
    reached = moved;
    const bool is_last = f.longest(dx) < options.step_tolerance;
    if (!is_accepted) f.move(dx.setZero(), 0);
    if (is_last) return report;
    if (!is_accepted) return stop(Status::NotConverged, "no step along Newton's direction descends");
    f.accept();
  }
}

}  // namespace testbed::meshing
