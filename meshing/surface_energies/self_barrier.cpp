#include "meshing/surface_energies/self_barrier.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <map>
#include <set>

#include "meshing/surface/surface.h"
#include "meshing/surface_energies/contact_laws.h"

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;
using Vector12 = Eigen::Matrix<double, 12, 1>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;

double mean_edge_of(const Matrix3Xd& X, const Eigen::Matrix2Xi& edges) {
  double length = 0;
  for (const auto& e : edges.colwise()) length += (X.col(e(0)) - X.col(e(1))).norm();
  return length / static_cast<double>(edges.cols());
}

/// Half the second derivative by the four nodes of the squared distance of a pair, its nearest points sliding.
Matrix12 half_hessian(const PairNodes& node, const NearestPoints& nearest, const Vector3d& e,
                      const Matrix3Xd& x) {
  Matrix12 S;
  const auto& w = nearest.weight;
  for (int a = 0; a < 4; ++a)
    for (int b = 0; b < 4; ++b) S.block<3, 3>(3 * a, 3 * b) = w[a] * w[b] * Matrix3d::Identity();
  const int n = nearest.n_slides;
  if (n == 0) return S;
  Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 2> tangents = Eigen::MatrixXd::Zero(3, n);
  for (int k = 0; k < n; ++k)
    for (int a = 0; a < 4; ++a) tangents.col(k) += nearest.slides(a, k) * x.col(node[a]);
  Eigen::Matrix<double, 12, Eigen::Dynamic, 0, 12, 2> by_slides(12, n);
  for (int k = 0; k < n; ++k)
    for (int a = 0; a < 4; ++a)
      by_slides.block<3, 1>(3 * a, k) = w[a] * tangents.col(k) + nearest.slides(a, k) * e;
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2, 2> G = tangents.transpose() * tangents;
  S -= by_slides * G.inverse() * by_slides.transpose();
  return S;
}

Matrix12 positive_part(const Matrix12& H) {
  const Eigen::SelfAdjointEigenSolver<Matrix12> eigen(H);
  const auto& V = eigen.eigenvectors();
  return V * eigen.eigenvalues().cwiseMax(0).asDiagonal() * V.transpose();
}

/// The part of the step p of four nodes at x, at most `part`, within which their distance is no less than `kept` of
/// what it is, or of the range where that is less [Li et al. 2021, algorithm 1].
double additive_ccd(bool is_edges, double range, const Matrix3Xd& x, Matrix3Xd p, double kept, double part) {
  constexpr double kConservative = 0.9, kNearly = 1.1;
  constexpr int kMaxSteps = 10000;
  const PairNodes node{0, 1, 2, 3};
  const auto distance = [&](double t) -> double {
    const Matrix3Xd at = x + t * p;
    return between(node, nearest_points(node, is_edges, at).weight, at).norm();
  };
  p.colwise() -= Vector3d(p.rowwise().mean());
  const int n_first = is_edges ? 2 : 1;
  const double closing =
      p.leftCols(n_first).colwise().norm().maxCoeff() + p.rightCols(4 - n_first).colwise().norm().maxCoeff();
  const double first = distance(0);
  if (first >= part * closing) return part;
  const double least = kept * std::min(first, range);
  double t = 0, d = first;
  for (int n = 0; n < kMaxSteps; ++n) {
    const double next = std::min(t + kConservative * (d - least) / closing, part);
    d = distance(next);
    if (d < least) return t;  // by rounding
    t = next;
    if (t == part || d <= kNearly * least) return t;
  }
  return t;
}

}  // namespace

double default_thickness(const Matrix3Xd& X, const Eigen::Matrix3Xi& F) {
  constexpr double kOfMeanEdge = 0.2;
  return kOfMeanEdge * mean_edge_of(X, edges_of(F));
}

SelfBarrier::SelfBarrier(const Matrix3Xd& X, const Eigen::Matrix3Xi& F, double E, double thickness,
                         double friction, IsCounted is_counted)
    : X_(X),
      F_(F),
      E_(edges_of(F)),
      vertex_area_(Eigen::VectorXd::Zero(X.cols())),
      edge_area_(Eigen::VectorXd::Zero(E_.cols())),
      thickness_(thickness),
      kappa_(kStiff * E / thickness),
      friction_(friction),
      mean_edge_(mean_edge_of(X, E_)),
      is_counted_(std::move(is_counted)) {
  const Matrix3Xd normals = area_vectors(X, F);
  std::map<std::pair<int, int>, int> edge;
  for (int e = 0; e < E_.cols(); ++e) edge[{E_(0, e), E_(1, e)}] = e;
  for (Eigen::Index f = 0; f < F.cols(); ++f)
    for (int k = 0; k < 3; ++k) {
      const double third = normals.col(f).norm() / 3;
      const int i = F(k, f), j = F((k + 1) % 3, f);
      vertex_area_(i) += third;
      edge_area_(edge.at(std::minmax(i, j))) += third;
    }
  const std::set<int> vertices(F.data(), F.data() + F.size());
  vertices_.resize(static_cast<Eigen::Index>(vertices.size()));
  std::copy(vertices.begin(), vertices.end(), vertices_.begin());
}

/// How far nodes have moved at most from x to y against their mean.
double SelfBarrier::moved(const Matrix3Xd& x, const Matrix3Xd& y) const {
  Matrix3Xd way = y(Eigen::all, vertices_) - x(Eigen::all, vertices_);
  way.colwise() -= Vector3d(way.rowwise().mean());
  return way.colwise().norm().maxCoeff();
}

void SelfBarrier::list(const Matrix3Xd& x, double margin) const {
  constexpr double kTouching = 1e-6;  // of the thickness, at rest
  listed_ = x;
  margin_ = margin;
  pairs_.clear();
  const auto distance = [](const PairNodes& node, bool is_edges, const Matrix3Xd& at) {
    return between(node, nearest_points(node, is_edges, at).weight, at).norm();
  };
  const double reach = thickness_ + 2 * margin;
  for_each_candidate(vertices_, E_, F_, x, reach, [&](const PairNodes& node, bool is_edges) {
    if (distance(node, is_edges, x) > reach) return;
    if (is_counted_ && !is_counted_(Eigen::Vector4i(node.data()))) return;
    const double range = std::min(thickness_, distance(node, is_edges, X_) / 2);
    if (range < kTouching * thickness_) return;
    pairs_.push_back({node, is_edges, range, 0, is_edges ? least_cross(node, X_) : 0});
  });
  // CGAL's order is not the same everywhere.
  std::sort(pairs_.begin(), pairs_.end(), [](const Pair& a, const Pair& b) {
    return std::pair(a.is_edges, a.node) < std::pair(b.is_edges, b.node);
  });
  constexpr double kQuarter = 0.25;
  const auto area_of_edge = [&](int i, int j) {
    const auto less = [](const auto& a, const auto& b) {
      return std::pair(a(0), a(1)) < std::pair(b(0), b(1));
    };
    const auto edges = E_.colwise();
    return edge_area_(std::lower_bound(edges.begin(), edges.end(), Eigen::Vector2i(i, j), less) -
                      edges.begin());
  };
  for (Pair& pair : pairs_) {
    const auto& n = pair.node;
    pair.stiffness =
        kQuarter * kappa_ *
        (pair.is_edges ? (area_of_edge(n[0], n[1]) + area_of_edge(n[2], n[3])) / 2 : vertex_area_(n[0]));
  }
}

const std::vector<SelfBarrier::Pair>& SelfBarrier::pairs_at(const Matrix3Xd& x) const {
  return pairs_along(x, Matrix3Xd::Zero(3, x.cols()));
}

const std::vector<SelfBarrier::Pair>& SelfBarrier::pairs_along(const Matrix3Xd& x,
                                                               const Matrix3Xd& dx) const {
  const bool is_known =
      listed_.cols() == x.cols() && moved(listed_, x) <= margin_ && moved(listed_, x + dx) <= margin_;
  constexpr double kMargin = 0.25;  // of the thickness
  if (!is_known) list(x, std::max(kMargin * thickness_, moved(x, x + dx)));
  return pairs_;
}

/// A pair closer than its range.
struct SelfBarrier::Near {
  const Pair& pair;
  NearestPoints nearest;
  Vector3d e;
  double d;
  BarrierValue b;

  Vector12 by_nodes() const {  // of d
    Vector12 gradient;
    for (int a = 0; a < 4; ++a) gradient.segment<3>(3 * a) = nearest.weight[a] / d * e;
    return gradient;
  }
};

template <class Visit>
void SelfBarrier::for_each_near(const Matrix3Xd& x, const Visit& visit) const {
  for (const Pair& pair : pairs_at(x)) {
    const NearestPoints nearest = nearest_points(pair.node, pair.is_edges, x);
    const Vector3d e = between(pair.node, nearest.weight, x);
    const double d = e.norm();
    if (!(d < pair.range)) continue;
    visit(Near{pair, nearest, e, d, barrier_at(d, pair.range)},
          pair.is_edges ? smoothing_of_edges(pair.node, x, pair.least) : Smoothing());
  }
}

double SelfBarrier::stored(const Matrix3Xd& x) const {
  double sum = 0;
  for_each_near(x, [&](const Near& near, const Smoothing& smoothing) {
    sum +=
        near.d > 0 ? near.pair.stiffness * smoothing.m * near.b.b : std::numeric_limits<double>::infinity();
  });
  return sum;
}

double SelfBarrier::energy(const Matrix3Xd& x) const {
  double sum = stored(x);
  for (const Held& held : held_) sum += held.limit * smooth_length(slid(held, x).norm(), slip_).value;
  return sum;
}

double SelfBarrier::friction(const Matrix3Xd& x) const {
  const double none = smooth_length(0, slip_).value;
  double sum = 0;
  for (const Held& held : held_)
    sum += held.limit * (smooth_length(slid(held, x).norm(), slip_).value - none);
  return sum;
}

void SelfBarrier::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  for_each_near(x, [&](const Near& near, const Smoothing& smoothing) {
    const Vector12 gradient = smoothing.m * near.b.db * near.by_nodes() + near.b.b * smoothing.gradient;
    for (int a = 0; a < 4; ++a) f.col(near.pair.node[a]) -= near.pair.stiffness * gradient.segment<3>(3 * a);
  });
  for (const Held& held : held_) {
    const Vector3d way = slid(held, x), force = held.limit / smooth_length(way.norm(), slip_).norm * way;
    for (int a = 0; a < 4; ++a) f.col(held.node[a]) -= held.weight[a] * force;
  }
}

void SelfBarrier::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature) const {
  for_each_near(x, [&](const Near& near, const Smoothing& smoothing) {
    const auto& [b, db, ddb] = near.b;
    const Vector12 by_nodes = near.by_nodes();
    const Matrix12 outer = by_nodes * by_nodes.transpose();
    Matrix12 sum =
        ddb * outer + db / near.d * (half_hessian(near.pair.node, near.nearest, near.e, x) - outer);
    if (smoothing.m < 1) {
      const Matrix12 mixed = db * smoothing.gradient * by_nodes.transpose();
      sum = (smoothing.m * sum + b * smoothing.hessian + mixed + mixed.transpose()).eval();
    }
    const Matrix12 positive = near.pair.stiffness * positive_part(sum);
    for (int a = 0; a < 4; ++a)
      for (int c = a; c < 4; ++c)
        H.blocks.push_back({near.pair.node[a], near.pair.node[c], positive.block<3, 3>(3 * a, 3 * c)});
  });
  for (const Held& held : held_) {
    const Matrix3d block = friction_hessian(held.limit, held.normal, held.friction, slid(held, x), slip_);
    for (int a = 0; a < 4; ++a)
      for (int c = a; c < 4; ++c)
        H.blocks.push_back({held.node[a], held.node[c], held.weight[a] * held.weight[c] * block});
  }
}

Vector3d SelfBarrier::slid(const Held& held, const Matrix3Xd& x) const {
  const Vector3d way = between(held.node, held.weight, x) - held.start;
  return way - held.normal.dot(way) * held.normal;
}

void SelfBarrier::begin_step(double, double h, const Matrix3Xd& x) {
  slip_ = kStillSpeed * thickness_ * h;
  held_.clear();
  if (friction_ == 0) return;
  for_each_near(x, [&](const Near& near, const Smoothing& smoothing) {
    const double limit = -friction_ * near.pair.stiffness * smoothing.m * near.b.db;
    held_.push_back({near.pair.node, near.nearest.weight, near.e / near.d, near.e, limit, Vector3d::Zero()});
  });
}

void SelfBarrier::follow(const Matrix3Xd& x, const Matrix3Xd& y) {
  for (Held& held : held_)
    held.friction = friction_foreseen(held.limit, held.friction, slid(held, x), slid(held, y), slip_);
}

double SelfBarrier::time_of_impact(const Matrix3Xd& x, const Matrix3Xd& dx, double kept) const {
  double part = 1;
  for (const Pair& pair : pairs_along(x, dx))
    part = additive_ccd(pair.is_edges, pair.range, x(Eigen::all, pair.node), dx(Eigen::all, pair.node), kept,
                        part);
  return part;
}

double SelfBarrier::largest_step(const Matrix3Xd& x, const Matrix3Xd& dx) const {
  constexpr double kKept = 0.1;  // of the distance
  const double way = moved(x, x + dx), part = way > mean_edge_ ? mean_edge_ / way : 1;
  return part * time_of_impact(x, part * dx, kKept);
}

bool SelfBarrier::keep_out(const Matrix3Xd& x, Matrix3Xd& y) const {
  constexpr double kKept = 0.1, kShorter = 0.9;
  const double part = time_of_impact(x, y - x, kKept);
  if (part == 1) return false;
  y = (x + kShorter * part * (y - x)).eval();
  return true;
}

bool SelfBarrier::passes_through(const Matrix3Xd& x, const Matrix3Xd& y) const {
  constexpr double kAny = 1e-3;
  return time_of_impact(x, y - x, kAny) < 1;
}

}  // namespace testbed::meshing
