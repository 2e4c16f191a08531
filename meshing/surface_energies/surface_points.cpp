#include "meshing/surface_energies/surface_points.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <map>

namespace testbed::meshing {
namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;

/// Adds W^T B W of a block at points p and q, and of its transpose at q and p.
void add_at_nodes(int p, int q, const Matrix3d& block, const SurfacePoints& W, SurfaceHessian& H) {
  for (SurfacePoints::InnerIterator a(W, p); a; ++a)
    for (SurfacePoints::InnerIterator b(W, q); b; ++b) {
      const int i = static_cast<int>(a.col()), j = static_cast<int>(b.col());
      const double w = a.value() * b.value();
      if (p == q && i > j) continue;  // the transpose of another
      if (p != q && i == j)
        H.blocks.push_back({i, i, w * (block + block.transpose())});
      else
        H.blocks.push_back({i, j, w * block});
    }
}

}  // namespace

Eigen::Matrix3Xd shape_functions(Eigen::Index n, double r, double s) {
  const Eigen::Vector3d l(1 - r - s, r, s);
  const Eigen::Matrix<double, 2, 3> dl = (Eigen::Matrix<double, 2, 3>() << -1, 1, 0, -1, 0, 1).finished();
  Eigen::Matrix3Xd N(3, n);
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    if (n == 3) {
      N.col(i) << l(i), dl.col(i);
      continue;
    }
    N.col(i) << l(i) * (2 * l(i) - 1), (4 * l(i) - 1) * dl.col(i);
    N.col(3 + i) << 4 * l(i) * l(j), 4 * (l(i) * dl.col(j) + l(j) * dl.col(i));
  }
  return N;
}

Eigen::Matrix3Xi flat_triangles(const Eigen::MatrixXi& faces) {
  if (faces.rows() == 3) return faces;
  Eigen::Matrix3Xi F(3, 4 * faces.cols());
  for (Eigen::Index t = 0; t < faces.cols(); ++t) {
    const auto n = faces.col(t);
    F.middleCols<4>(4 * t) << n(0), n(3), n(5), n(3),  //
        n(3), n(1), n(4), n(4),                        //
        n(5), n(4), n(2), n(5);
  }
  return F;
}

SurfacePoints points_on(const Eigen::MatrixXi& faces, const Matrix3Xd& places, Eigen::Index n_nodes) {
  std::vector<Eigen::Triplet<double>> entries;
  int p = 0;
  for (const auto& face : faces.colwise())
    for (const auto& place : places.colwise()) {
      const Matrix3Xd N = shape_functions(faces.rows(), place(1), place(2));
      for (Eigen::Index a = 0; a < faces.rows(); ++a)
        if (N(0, a) != 0) entries.emplace_back(p, face(a), N(0, a));
      ++p;
    }
  SurfacePoints points(p, n_nodes);
  points.setFromTriplets(entries.begin(), entries.end());
  return points;
}

ContactPoints contact_points(const Eigen::MatrixXi& faces, const Matrix3Xd& X,
                             const std::vector<char>& is_constrained, const IsCounted& is_counted) {
  constexpr double kCorner = 1. / 20, kMiddle = 2. / 15, kCentroid = 9. / 20;
  std::vector<Eigen::Triplet<double>> entries;
  std::vector<ContactPoints::Share> shares;
  int n_points = 0;
  std::map<std::pair<int, int>, int> shared;  // the point of a corner, twice, or of an edge; -1: constrained
  const auto add = [&](const Eigen::VectorXi& face, double r, double s) {
    const Matrix3Xd N = shape_functions(face.size(), r, s);
    std::vector<int> on;  // nodes of the face
    for (int a = 0; a < face.size(); ++a)
      if (N(0, a) != 0) on.push_back(a);
    if (std::all_of(on.begin(), on.end(), [&](int a) { return is_constrained[face(a)]; })) return -1;
    if (is_counted && !is_counted(face(on))) return -1;
    for (const int a : on) entries.emplace_back(n_points, face(a), N(0, a));
    return n_points++;
  };
  for (int f = 0; f < faces.cols(); ++f) {
    const Eigen::VectorXi face = faces.col(f);
    const Eigen::Vector3d a = X.col(face(0)), b = X.col(face(1)), c = X.col(face(2));
    const double area = (b - a).cross(c - a).norm() / 2;
    for (int i = 0; i < 3; ++i)
      for (const int j : {i, (i + 1) % 3}) {
        Eigen::Vector3d place = Eigen::Vector3d::Zero();
        place(i) += 0.5;
        place(j) += 0.5;
        const auto [found, is_new] = shared.try_emplace(std::minmax(face(i), face(j)), -1);
        if (is_new) found->second = add(face, place(1), place(2));
        if (found->second >= 0) shares.push_back({found->second, f, area * (i == j ? kCorner : kMiddle)});
      }
    if (const int p = add(face, 1. / 3, 1. / 3); p >= 0) shares.push_back({p, f, kCentroid * area});
  }
  ContactPoints points{SurfacePoints(n_points, X.cols()), std::move(shares)};
  points.W.setFromTriplets(entries.begin(), entries.end());
  return points;
}

SurfaceHessian at_nodes(const SurfaceHessian& H, const SurfacePoints& W) {
  SurfaceHessian result;
  H.for_each_block([&](int p, int q, const Matrix3d& block) {
    if (!block.isZero(0)) add_at_nodes(p, q, block, W, result);
  });
  for (const Matrix3Xd& g : H.roots) result.roots.emplace_back(g * W.topRows(g.cols()));
  return result;
}

bool EnergyOfPoints::keep_out(const Matrix3Xd& x, Matrix3Xd& y) const {
  constexpr int kMaxSweeps = 20;
  const Matrix3Xd from = at_points(x);
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    const Matrix3Xd before = y, at = at_points(y);
    Matrix3Xd kept = at;
    if (!energy_->keep_out(from, kept)) return sweep > 0;
    for (int p = 0; p < W_.rows(); ++p) {
      const Eigen::Vector3d way = kept.col(p) - at.col(p);
      if (way.isZero(0)) continue;
      const Eigen::Vector3d direction = way.normalized();
      for (SurfacePoints::InnerIterator a(W_, p); a; ++a) {
        const double gone = (y.col(a.col()) - before.col(a.col())).dot(direction);
        y.col(a.col()) += std::max(0., way.norm() - gone) * direction;
      }
    }
  }
  return true;
}

void EnergyOfPoints::add_forces(const Matrix3Xd& x, Matrix3Xd& f) const {
  Matrix3Xd at = Matrix3Xd::Zero(3, W_.rows());
  energy_->add_forces(at_points(x), at);
  f += at * W_;
}

void EnergyOfPoints::add_hessian(const Matrix3Xd& x, SurfaceHessian& H, Curvature curvature) const {
  SurfaceHessian at;
  energy_->add_hessian(at_points(x), at, curvature);
  const SurfaceHessian mapped = at_nodes(at, W_);
  H.blocks.insert(H.blocks.end(), mapped.blocks.begin(), mapped.blocks.end());
  H.roots.insert(H.roots.end(), mapped.roots.begin(), mapped.roots.end());
}

}  // namespace testbed::meshing
