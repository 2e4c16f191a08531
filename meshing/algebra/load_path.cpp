#include "meshing/algebra/load_path.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace testbed::meshing {

using Eigen::Matrix3Xd;

/// The lowest in energy of x, and the line and the parabola through the last equilibria.
void LoadPath::predict(const LoadedBody& body, double load_factor, Matrix3Xd& x) const {
  body.prescribe(load_factor, x);
  if (last_.size() < 2) return;
  double lowest = body.energy(load_factor, x);
  for (size_t n_points = 2; n_points <= last_.size(); ++n_points) {
    const auto begin = last_.end() - static_cast<std::ptrdiff_t>(n_points);
    Matrix3Xd ahead = Matrix3Xd::Zero(3, x.cols());
    for (auto point = begin; point != last_.end(); ++point) {
      double weight = 1;
      for (auto other = begin; other != last_.end(); ++other)
        if (other != point)
          weight *= (load_factor - other->load_factor) / (point->load_factor - other->load_factor);
      ahead += weight * point->x;
    }
    body.prescribe(load_factor, ahead);
    if (const double energy = body.energy(load_factor, ahead); energy < lowest) {
      lowest = energy;
      x = std::move(ahead);
    }
  }
}

bool LoadPath::follow(const LoadedBody& body, double load_factor, Matrix3Xd& x) {
  constexpr double kShortest = 1. / 64;  // of the way
  constexpr double kRounding = 1e-9;     // of a stride: what it would leave is no step
  constexpr int kMaxCuts = 3;            // in a row
  constexpr size_t kPoints = 3;
  const double shortest = kShortest * std::abs(load_factor - last_.back().load_factor);
  Matrix3Xd start = x;
  int n_cuts = 0;
  while (true) {
    const double from = last_.back().load_factor, way = load_factor - from;
    const bool is_last = std::abs(way) <= (1 + kRounding) * stride_;
    const double next = is_last ? load_factor : from + std::copysign(stride_, way);
    predict(body, next, x);
    if (body.balance(next, x)) {
      const auto is_there = [&](const Equilibrium& e) { return e.load_factor == next; };
      last_.erase(std::remove_if(last_.begin(), last_.end(), is_there), last_.end());
      if (last_.size() == kPoints) last_.erase(last_.begin());
      last_.push_back({next, x});
      if (is_last) return true;
      start = x;
      stride_ *= 2;
      n_cuts = 0;
    } else {
      stride_ = std::min(stride_, std::abs(way)) / 2;
      x = start;
      if (++n_cuts > kMaxCuts || stride_ < shortest || way == 0) {
        stride_ = std::numeric_limits<double>::infinity();
        return false;
      }
    }
  }
}

}  // namespace testbed::meshing
