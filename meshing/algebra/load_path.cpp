#include "meshing/algebra/load_path.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace testbed::meshing {

using Eigen::Matrix3Xd;

/// The lowest in energy of x, and the line and the parabola through the last equilibria.
void LoadPath::predict(const LoadedBody& body, double load_factor, Matrix3Xd& x) const {
  body.prescribe(load_factor, x);
  if (last.size() < 2) return;
  double lowest = body.energy(load_factor, x);
  for (size_t n_points = 2; n_points <= last.size(); ++n_points) {
    const auto begin = last.end() - static_cast<std::ptrdiff_t>(n_points);
    Matrix3Xd ahead = Matrix3Xd::Zero(3, x.cols());
    for (auto point = begin; point != last.end(); ++point) {
      double weight = 1;
      for (auto other = begin; other != last.end(); ++other)
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
  const double shortest = kShortest * std::abs(load_factor - last.back().load_factor);
  Matrix3Xd start = x;
  int n_cuts = 0;
  while (true) {
    const double from = last.back().load_factor, way = load_factor - from;
    const bool is_last = std::abs(way) <= (1 + kRounding) * stride;
    const double next = is_last ? load_factor : from + std::copysign(stride, way);
    predict(body, next, x);
    if (body.balance(next, x)) {
      const auto is_there = [&](const Equilibrium& e) { return e.load_factor == next; };
      last.erase(std::remove_if(last.begin(), last.end(), is_there), last.end());
      if (last.size() == kPoints) last.erase(last.begin());
      last.push_back({next, x});
      if (is_last) return true;
      start = x;
      stride *= 2;
      n_cuts = 0;
    } else {
      stride = std::min(stride, std::abs(way)) / 2;
      x = start;
      if (++n_cuts > kMaxCuts || stride < shortest || way == 0) {
        stride = std::numeric_limits<double>::infinity();
        return false;
      }
    }
  }
}

}  // namespace testbed::meshing
